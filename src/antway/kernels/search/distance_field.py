"""Exact distances on 4 and 8 neighbours without a heap.

Open cells lie in a ring of lists, one for each band [low, low + 1) of distances. No move is shorter than 1, so no cell of a
band can improve another of the same band, and they can be settled in any order. Canonical successors (see `canonical`) reach
most cells only once, and in open space a straight move has one successor: the same move. Such a run is continued at once, up
to the first cell with other successors, the first that was reached at no greater cost, or the last band of the ring; only that
cell enters a list. A label that a run sets too high is lowered later, from the other side. Distances are sums of the fine
lengths (see `lengths`), in float64.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.search.canonical import START, Lattice
from antway.kernels.search.lengths import FINE_DIAGONAL, FINE_STRAIGHT

STRAIGHT, DIAGONAL = float(FINE_STRAIGHT), float(FINE_DIAGONAL)
RUNNING, DONE, FULL = 0, 1, 2
RING = 64  # number of lists
# Indices of `state`: number of the band, cells in lists, first recycled entry, entries ever used, cells expanded.
BAND, OPEN, FREE, USED, EXPANDED = range(5)


class Memory(NamedTuple):
    """A search between two calls."""

    label: NDArray[np.float64]  # [cells] distances in 1 / STRAIGHT cells, infinite if not reached; final below the band
    first: NDArray[np.int64]  # [RING] first entry of each list, or -1; band b has list b & (RING - 1)
    entries: NDArray[np.int64]  # [M, 2] open cell as 16 * cell + direction of arrival, and the next entry of its list
    state: NDArray[np.int64]  # [5] see above


@inner_kernel
def run_straight(lattice: Lattice, label: NDArray[np.float64], cell: int, d: int) -> tuple[int, int]:
    """Label the cells of a run from `cell` in the straight direction d; return its last cell, and how many cells it has.

    The number is 0 if the last cell need not be expanded: no move continues from it, or it was reached at no greater cost.
    """
    around, table, step = lattice.around, lattice.table, lattice.offsets[d]
    on = more = np.uint8(1 << d)
    g, ahead = label[cell], 0
    while more == on and ahead < RING - 1:
        cell += step
        g += STRAIGHT
        ahead += 1
        if g >= label[cell]:
            return cell, 0
        label[cell] = g
        more = table[d << 8 | np.int64(around[cell])]
    return cell, ahead if more else 0


@bare_kernel
def _are_settled(label: NDArray[np.float64], targets: NDArray[np.int64], low: float) -> bool:
    """Tell whether there are targets, and all of them have labels below `low`."""
    for target in targets:
        if label[target] >= low:
            return False
    return targets.size > 0


@bare_kernel
def spread(lattice: Lattice, targets: NDArray[np.int64], within: float, memory: Memory, steps: int) -> int:
    """Expand about `steps` cells; return RUNNING, DONE, or FULL if `entries` must be longer.

    The search is done once all `targets` (if any) are settled, or when the band starts beyond `within`.
    """
    around, table, offsets = lattice.around, lattice.table, lattice.offsets
    label, first, entries, state = memory.label, memory.first, memory.entries, memory.state
    band, opened, free, used = state[BAND], state[OPEN], state[FREE], state[USED]
    code = RUNNING
    while code == RUNNING and steps > 0:
        low = band * STRAIGHT
        if low > within or opened == 0 or _are_settled(label, targets, low):
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
                if d < 4:
                    to, ahead = run_straight(lattice, label, cell, d)
                    if ahead == 0:
                        continue
                else:
                    to, g_to = cell + offsets[d], g + DIAGONAL
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
def descend(lattice: Lattice, label: NDArray[np.float64], cell: int) -> NDArray[np.int64]:
    """Return the flat cells of a shortest path from `cell` to a label of 0."""
    around, table, offsets = lattice.around, lattice.table, lattice.offsets
    path = [cell]
    while label[cell] > 0:
        moves = table[START << 8 | np.int64(around[cell])]
        for d in range(8):
            if moves >> d & 1 and label[cell + offsets[d]] + (STRAIGHT if d < 4 else DIAGONAL) == label[cell]:
                cell += offsets[d]
                break
        path.append(cell)
    return np.array(path)
