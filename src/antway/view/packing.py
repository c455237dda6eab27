"""Numbers as pictures and pages take them: packed into text, rounded, or scaled to shades."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


def to_base64(values: NDArray[Any], dtype: str) -> str:
    """Return numbers as base64 of their bytes as `dtype`, such as "<f4"."""
    return base64.b64encode(np.ascontiguousarray(values).astype(dtype).tobytes()).decode()


def bits_to_base64(mask: NDArray[np.bool_]) -> str:
    """Return a mask as base64 of its bits, row by row, the lowest bit of a byte first."""
    return base64.b64encode(np.packbits(mask.ravel(), bitorder="little").tobytes()).decode()


def rounded(value: float, digits: int = 6) -> float | None:
    """Return a number with this many decimal places for JSON; None if it is not finite."""
    return round(float(value), digits) + 0.0 if math.isfinite(value) else None  # never -0.0


def faint_scale(amount: NDArray[Any]) -> NDArray[Any]:
    """Scale pheromone from 0 (least) to 1 (most), by the square root so that faint trails are visible."""
    low, high = float(amount.min()), float(amount.max())
    return np.sqrt((amount - low) / (high - low)) if high > low else np.zeros_like(amount)
