"""Kernels of exact search on grids."""
