"""Exact distances on 4 and 8 neighbours without a heap.

Open cells lie in a ring of lists, one for each band [low, low + 1) of distances. No move is shorter than 1, so no cell of a
band can better another of the same band, and they are settled in whatever order they came. Canonical successors (see
`canonical`) reach most cells just once, and in the open a straight move has but one: itself again. It is run on at once, up to
the first cell with more to offer, the first that is reached as well already, or the last band of the ring; only there does a
cell enter a list. What such a run reaches too early from the wrong side is bettered when the right side comes. Lengths are
integers in the proportion of a convergent of sqrt 2 fine enough that they compare as a + b sqrt 2 does while b is below 38
million, and their sums are exact in float64.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import kernel
from antway.kernels.search.canonical import START

STRAIGHT, DIAGONAL = 38613965.0, 54608393.0
RUNNING, DONE, FULL = 0, 1, 2
RING = 64  # lists
BAND, OPEN, FREE, USED, EXPANDED = 0, 1, 2, 3, 4
"""Places in `state`: number of the band, cells in lists, first of the recycled entries, entries ever used, cells expanded."""


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
    """Expand about `steps` cells; return RUNNING, DONE, or FULL where `entries` must be longer.

    Parameters
    ----------
    around, table, offsets
        Surroundings of the cells, canonical successors (see `canonical`), flat offsets of the 8 directions.
    targets, within
        Stop once all `targets` (if any) are settled, or when the band begins beyond `within`.
    label : float64[cells]
        Distances in units of 1 / STRAIGHT cells, infinite where not yet reached. All below `state[BAND] * STRAIGHT` are final.
    first : int64[RING]
        The first entry of the list of each band, -1: none. Band b has list b & (RING - 1).
    entries : int64[M, 2]
        An open cell, as 16 * cell + direction of arrival, and the next entry of its list.
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
                continue  # it came in an earlier band as well
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
    """Return the flat cells of a shortest path from `cell` down to a label of 0."""
    path = [cell]
    while label[cell] > 0:
        moves = table[START << 8 | np.int64(around[cell])]
        for d in range(8):
            if moves >> d & 1 and label[cell + offsets[d]] + (STRAIGHT if d < 4 else DIAGONAL) == label[cell]:
                cell += offsets[d]
                break
        path.append(cell)
    return np.array(path)
