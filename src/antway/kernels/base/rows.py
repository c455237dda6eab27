"""Copies rows of tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel


@bare_kernel
def copy_row(source: NDArray[np.generic], into: NDArray[np.generic]) -> None:
    """Copy `source`, [N], to `into`, [N].

    For `into[:] = source` Numba also compiles the error message for different shapes, which takes seconds.
    """
    for k in range(len(into)):
        into[k] = source[k]


@bare_kernel
def copy_rows(source: NDArray[np.generic], into: NDArray[np.generic]) -> None:
    """Copy `source`, [N, M], to `into`, [N, M]."""
    for k in range(len(into)):
        copy_row(source[k], into[k])
