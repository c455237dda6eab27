"""Numba kernels: arrays and numbers in, arrays and numbers out. No classes, no files, no randomness they are not handed."""
