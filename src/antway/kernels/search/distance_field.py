"""Exact distances on 4 and 8 neighbours without a heap.

Open cells lie in a ring of lists, one for each band [low, low + 1) of distances. No move is shorter than 1, so no cell of a
band can improve another of the same band, and they can be settled in any order. Canonical successors (see `canonical`) reach
most cells only once, and in open space a straight move has one successor: the same move. Such a run is continued at once, up
to the first cell with other successors, the first that was reached at no greater cost, or the last band of the ring; only that
cell enters a list. A label that a run sets too high is lowered later, from the other side. Lengths are integers in the ratio
of a convergent of sqrt 2 so fine that they compare as a + b sqrt 2 does for b below 38 million. Their sums are exact in
float64.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import kernel
from antway.kernels.search.canonical import START

STRAIGHT, DIAGONAL = 38613965.0, 54608393.0
RUNNING, DONE, FULL = 0, 1, 2
RING = 64  # number of lists
BAND, OPEN, FREE, USED, EXPANDED = 0, 1, 2, 3, 4
"""Indices of `state`: number of the band, cells in lists, first recycled entry, entries ever used, cells expanded."""


@kernel
def spread(
    around: NDArray[np.uint8],
    table: NDArray[np.uint8],
    offsets: NDArray[np.int64],
    targets: NDArray[np.int64],
    within: float,
    label: NDArray[np.float64],
    first: NDArray[np.int64],
    entries: NDArray[np.int64],
    state: NDArray[np.int64],
    steps: int,
) -> int:
    """Expand about `steps` cells; return RUNNING, DONE, or FULL if `entries` must be longer.

    Parameters
    ----------
    around, table, offsets
        Surroundings of the cells, canonical successors (see `canonical`), flat steps of the 8 directions.
    targets, within
        Stop once all `targets` (if any) are settled, or when the band starts beyond `within`.
    label : float64[cells]
        Distances in units of 1 / STRAIGHT cells, infinite if not reached. Those below `state[BAND] * STRAIGHT` are final.
    first : int64[RING]
        The first entry of each list, or -1. Band b has list b & (RING - 1).
    entries : int64[M, 2]
        An open cell as 16 * cell + direction of arrival, and the next entry of its list.
    state : int64[5]
        See above.
    """
    band, opened, free, used = state[BAND], state[OPEN], state[FREE], state[USED]
    code = RUNNING
    while code == RUNNING and steps > 0:
        low = band * STRAIGHT
        unsettled = targets.size == 0
        for target in targets:
            if label[target] >= low:
                unsettled = True
                break
        if low > within or not unsettled or opened == 0:
            code = DONE
            break
        entry = first[band & (RING - 1)]
        while entry >= 0:
            if used > entries.shape[0] - 8:
                code = FULL
                break
            item, after = entries[entry, 0], entries[entry, 1]
            entries[entry, 1] = free
            free, entry = entry, after
            opened -= 1
            steps -= 1
            cell = item >> 4
            g = label[cell]
            if g < low:
                continue  # it was settled in an earlier band
            moves = np.uint64(table[(item & 15) << 8 | np.int64(around[cell])])
            while moves:
                d = ctz(moves)
                moves &= moves - np.uint64(1)
                to, g_to, ahead = cell, g, 0
                if d < 4:
                    on = more = np.uint8(1 << d)
                    while more == on and ahead < RING - 1:
                        to += offsets[d]
                        g_to += STRAIGHT
                        ahead += 1
                        if g_to >= label[to]:
                            more = np.uint8(0)
                        else:
                            label[to] = g_to
                            more = table[d << 8 | np.int64(around[to])]
                    if more == 0:
                        continue
                else:
                    to += offsets[d]
                    g_to += DIAGONAL
                    if g_to >= label[to]:
                        continue
                    label[to] = g_to
                    ahead = 1 if g_to < low + 2 * STRAIGHT else 2
                slot = (band + ahead) & (RING - 1)
                new = free
                if new >= 0:
                    free = entries[new, 1]
                else:
                    new = used
                    used += 1
                entries[new, 0], entries[new, 1] = to << 4 | d, first[slot]
                first[slot] = new
                opened += 1
            state[EXPANDED] += 1
        first[band & (RING - 1)] = entry
        band += entry < 0
    state[BAND], state[OPEN], state[FREE], state[USED] = band, opened, free, used
    return code


@kernel
def descend(
    around: NDArray[np.uint8], table: NDArray[np.uint8], offsets: NDArray[np.int64], label: NDArray[np.float64], cell: int
) -> NDArray[np.int64]:
    """Return the flat cells of a shortest path from `cell` to a label of 0."""
    path = [cell]
    while label[cell] > 0:
        moves = table[START << 8 | np.int64(around[cell])]
        for d in range(8):
            if moves >> d & 1 and label[cell + offsets[d]] + (STRAIGHT if d < 4 else DIAGONAL) == label[cell]:
                cell += offsets[d]
                break
        path.append(cell)
    return np.array(path)
