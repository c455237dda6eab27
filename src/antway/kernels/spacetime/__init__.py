"""Kernels of search and of ants in space and time."""
