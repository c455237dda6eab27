"""Exact search on grids."""
