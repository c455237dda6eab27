"""A polygon footprint as discs that cover it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter


def covering_discs(polygon: ArrayLike, count: int) -> tuple[NDArray[np.float64], float]:
    """Return the centres, float64[count, 2], and the radius in m of equal discs that cover the box around `polygon`.

    They are in a row along the longer side; each covers its part of the box exactly to the corners.

    Raises
    ------
    BadParameter
    """
    points = checks.array("polygon", polygon, (None, 2))
    if len(points) < 3:
        raise BadParameter("polygon", len(points), "at least 3 corners")
    count = checks.integer("count", count, low=1, high=1000)
    low, high = points.min(axis=0), points.max(axis=0)
    axis = int(np.argmax(high - low))
    step = (high[axis] - low[axis]) / count
    centres = np.tile((low + high) / 2.0, (count, 1))
    centres[:, axis] = low[axis] + step * (np.arange(count) + 0.5)
    return centres, math.hypot(step, float(high[1 - axis] - low[1 - axis])) / 2.0
