"""Kernels that follow obstacles and predict them."""
