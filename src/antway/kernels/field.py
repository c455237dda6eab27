"""Exact distances on 4 and 8 neighbours without a heap.

Open cells lie in three lists by distance: in the current band [low, low + 1) and the two that follow. No move is shorter than
1, so no cell of a band can better another of the same band, and they are settled in whatever order they came. Canonical
successors (see `canonical`) reach most cells just once. Lengths are integers in the proportion of a convergent of sqrt 2 fine
enough that they compare as a + b sqrt 2 does while b is below 38 million, and their sums are exact in float64.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.bits import ctz, prefetch
from antway.kernels.jit import kernel

STRAIGHT, DIAGONAL = 38613965.0, 54608393.0
RUNNING, DONE, FULL = 0, 1, 2
AHEAD = 12  # how many cells before its turn the memory of a cell is asked for


@kernel
def spread(
    around: NDArray[np.uint8],
    table: NDArray[np.uint8],
    offsets: NDArray[np.int64],
    targets: NDArray[np.int64],
    within: float,
    label: NDArray[np.float64],
    lists: NDArray[np.int64],
    state: NDArray[np.int64],
    steps: int,
) -> int:
    """Settle about `steps` cells; return RUNNING, DONE, or FULL where `lists` must be longer.

    Parameters
    ----------
    around, table, offsets
        Surroundings of the cells, canonical successors (see `canonical`), flat offsets of the 8 directions.
    targets, within
        Stop once all `targets` (if any) are settled, or when the band begins beyond `within`.
    label : float64[cells]
        Distances in units of 1 / STRAIGHT cells, infinite where not yet reached. All below `state[0] * STRAIGHT` are final.
    lists : int64[3, M]
        The open cells of band b in list b % 3, each as 16 * cell + direction of arrival.
    state : int64[6]
        Number of the band, next place in its list, lengths of the three lists, cells expanded.
    """
    band, begin = state[0], state[1]
    room = lists.shape[1]
    code = RUNNING
    while steps > 0:
        now, soon, later = band % 3, (band + 1) % 3, (band + 2) % 3
        n_now, n_soon, n_later = state[2 + now], state[2 + soon], state[2 + later]
        if begin == 0:
            unsettled = targets.size == 0
            for target in targets:
                unsettled |= label[target] >= band * STRAIGHT
            if band * STRAIGHT > within or not unsettled or n_now + n_soon == 0:
                code = DONE
                break
        end = min(n_now, begin + steps, begin + (room - AHEAD - max(n_soon, n_later)) // 8)
        if end == begin < n_now:
            code = FULL
            break
        low, limit = band * STRAIGHT, (band + 2) * STRAIGHT
        for i in range(begin, end):
            ahead = lists[now, i + AHEAD]
            prefetch(around, ahead >> 4)
            prefetch(label, (ahead >> 4) + offsets[ahead & 7])
            cell = lists[now, i] >> 4
            g = label[cell]
            if g < low:
                continue  # it came in an earlier band as well
            moves = np.uint64(table[9 * np.int64(around[cell]) + (lists[now, i] & 15)])
            while moves:
                d = ctz(moves)
                moves &= moves - np.uint64(1)
                to = cell + offsets[d]
                g_to = g + (STRAIGHT if d < 4 else DIAGONAL)
                if g_to < label[to]:
                    label[to] = g_to
                    if g_to < limit:
                        lists[soon, n_soon] = to << 4 | d
                        n_soon += 1
                    else:
                        lists[later, n_later] = to << 4 | d
                        n_later += 1
        state[2 + soon], state[2 + later] = n_soon, n_later
        state[5] += end - begin
        steps -= end - begin + 1
        begin = end
        if end == n_now:
            state[2 + now] = begin = 0
            band += 1
    state[0], state[1] = band, begin
    return code


@kernel
def descend(
    around: NDArray[np.uint8], table: NDArray[np.uint8], offsets: NDArray[np.int64], label: NDArray[np.float64], cell: int
) -> NDArray[np.int64]:
    """Return the flat cells of a shortest path from `cell` down to a label of 0."""
    path = [cell]
    while label[cell] > 0:
        moves = table[9 * np.int64(around[cell]) + 8]
        for d in range(8):
            if moves >> d & 1 and label[cell + offsets[d]] + (STRAIGHT if d < 4 else DIAGONAL) == label[cell]:
                cell += offsets[d]
                break
        path.append(cell)
    return np.array(path)
