"""Kernels of ant colonies on graphs."""
