"""Rows of tables are copied."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel


@bare_kernel
def copy_row(source: NDArray[np.generic], into: NDArray[np.generic]) -> None:
    """Copy `source`, [N], to `into`, [N].

    For `into[:] = source` Numba compiles how to write down both shapes, should they differ: that takes seconds.
    """
    for k in range(len(into)):
        into[k] = source[k]
