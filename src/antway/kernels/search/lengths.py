"""Lengths of moves to 4 and 8 neighbours as integers, in the ratio of a convergent of 1 : sqrt 2.

Sums a * STRAIGHT + b * DIAGONAL over paths of a straight and b diagonal moves have the order of a + b sqrt 2 as long as their
values of b differ by less than STRAIGHT. The same holds for the fine lengths.
"""

from __future__ import annotations

from antway.kernels.base.jit import inner_kernel

STRAIGHT, DIAGONAL = 5741, 8119  # small, for sums in 32 bits
FINE_STRAIGHT, FINE_DIAGONAL = 38613965, 54608393  # large; sums are exact in float64 up to 2^53


@inner_kernel
def octile(row: int, col: int, to_row: int, to_col: int, straight: int, shorter: int) -> int:
    """Return the distance of two cells on an empty map.

    `straight` is the cost of a cell along the longer side of their bounding box, and `shorter` of one along the shorter side:
    the same for 4 moves; for 8 the difference of a diagonal and a straight move.
    """
    a, b = abs(row - to_row), abs(col - to_col)
    return straight * max(a, b) + shorter * min(a, b)
