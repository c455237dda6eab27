"""Kernels that turn a path into a motion."""
