"""Kernels of the simulated robot, its sensor and its guard."""
