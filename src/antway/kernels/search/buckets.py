"""A monotone priority queue for integer keys in [0, LIMIT): buckets of one key each within the current block of 2^14 keys, and
one bucket for each later block, spread out when its turn comes. Keys never fall below the last one taken off.

A cell may be in the queue more than once; what is out of date is known by its label, so nothing is ever moved or removed.

The arrays: `first` int32[2^14 + 2^12], the first entry of each bucket (-1: none), of the keys of the block and then of the
blocks; `filled` uint64[2^8], a bit for each key of the block that has entries; `entries` int32[M, 5], each the next entry, row,
col, g and key; `state` int64[8], whose places are named below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import kernel

# 5741 : 8119 is a convergent of 1 : sqrt 2. Sums a * 5741 + b * 8119 are ordered as a + b sqrt 2 is while the b of any two
# differ by less than 5741, and below LIMIT there is no room for a larger b.
STRAIGHT, DIAGONAL = 5741, 8119
LIMIT = STRAIGHT * DIAGONAL
KEYS, BLOCKS = 1 << 14, 1 << 12

USED, FREE, KEY, LAST, EXPANDED, CUT, BOUND = 0, 1, 2, 3, 4, 5, 6
"""Places in `state`: entries ever used, first of the recycled ones, the last key taken off, the last block with entries, cells
expanded, whether something beyond LIMIT was left out, and the cost of the best path to the goal so far."""


@kernel
def reset(first: NDArray[np.int32], filled: NDArray[np.uint64], state: NDArray[np.int64]) -> None:
    """Empty the queue."""
    for word in range(filled.size):
        while filled[word]:
            first[64 * word + ctz(filled[word])] = -1
            filled[word] &= filled[word] - np.uint64(1)
    first[KEYS : KEYS + state[LAST] + 1] = -1
    state[:] = 0
    state[FREE] = -1
    state[BOUND] = LIMIT


@kernel
def next_block(first: NDArray[np.int32], filled: NDArray[np.uint64], entries: NDArray[np.int32], key: int, last: int) -> int:
    """Spread the entries of the next block that has any over its keys; return its first key, or -1 if there is none."""
    block = (key >> 14) + 1
    while block <= last and first[KEYS + block] < 0:
        block += 1
    if block > last:
        return -1
    entry = first[KEYS + block]
    first[KEYS + block] = -1
    while entry >= 0:
        after = entries[entry, 0]
        bucket = entries[entry, 4] & (KEYS - 1)
        entries[entry, 0] = first[bucket]
        first[bucket] = entry
        filled[bucket >> 6] |= np.uint64(1) << np.uint64(bucket & 63)
        entry = after
    return block << 14
