"""Tables with one row for each track."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.rows import copy_row

_LOST = 1.0  # s; a track that was not seen for longer is dropped


@bare_kernel
def row_of(rows: NDArray[np.float64], count: int, column: int, name: float) -> int:
    """Return the first row below `count` that has this name in `column`, or `count` if there is none."""
    i = 0
    while i < count and rows[i, column] != name:
        i += 1
    return i


@bare_kernel
def drop_lost(rows: NDArray[np.float64], count: int, column: int, t: float) -> int:
    """Drop those of the first `count` rows whose time in `column` is more than 1 s before `t`; return how many are left."""
    kept = 0
    for i in range(count):
        if t - rows[i, column] <= _LOST:
            if kept != i:
                copy_row(rows[i], rows[kept])
            kept += 1
    return kept
