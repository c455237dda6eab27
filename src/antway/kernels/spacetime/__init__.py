"""Kernels of the search and of the ants in space and time."""
