"""A monotone priority queue for integer keys in [0, LIMIT), which never fall below the last key taken off.

There is a bucket for each key of the current block of 2^14 keys, and one bucket for each later block, which is spread out when
its turn comes. A cell may be in the queue more than once. Outdated entries are recognised by the cell's label, so no entry is
ever moved or removed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.search.lengths import DIAGONAL, STRAIGHT

LIMIT = STRAIGHT * DIAGONAL  # a path that costs less has fewer than STRAIGHT diagonals, so that costs compare as lengths do
KEYS, BLOCKS = 1 << 14, 1 << 12  # keys of a block, and blocks; KEYS * BLOCKS exceeds LIMIT

# Indices of `state`: entries ever used, first recycled entry, last key taken off, last block with entries, cells expanded,
# whether a key beyond LIMIT was left out, cost of the best path to the goal so far.
USED, FREE, KEY, LAST, EXPANDED, CUT, BOUND = range(7)


class Queue(NamedTuple):
    """The memory of a queue, used again by each search."""

    first: NDArray[np.int32]  # [KEYS + BLOCKS] first entry of each bucket or -1: of the keys of the block, then of the blocks
    filled: NDArray[np.uint64]  # [KEYS / 64] a bit for each key of the current block, set if it has entries
    entries: NDArray[np.int32]  # [M, 5] next entry of the same bucket, row, col, g, key
    state: NDArray[np.int64]  # [7] see above


@bare_kernel
def reset(queue: Queue) -> None:
    """Empty the queue."""
    first, filled, state = queue.first, queue.filled, queue.state
    for word in range(filled.size):
        while filled[word]:
            first[64 * word + ctz(filled[word])] = -1
            filled[word] &= filled[word] - np.uint64(1)
    first[KEYS : KEYS + state[LAST] + 1] = -1
    state[:] = 0
    state[FREE] = -1
    state[BOUND] = LIMIT


@inner_kernel
def take(queue: Queue, at: int) -> tuple[int, int]:
    """Take an entry of least key, which is at least `at`, off the queue; return it and its key, or -1, -1."""
    first, filled, entries = queue.first, queue.filled, queue.entries
    word = (at & (KEYS - 1)) >> 6
    while True:
        while word < filled.size and filled[word] == 0:
            word += 1
        if word < filled.size:
            break
        at = next_block(queue, at)
        if at < 0:
            return -1, -1
        word = 0
    bucket = 64 * word + ctz(filled[word])
    entry = first[bucket]
    first[bucket] = entries[entry, 0]
    if entries[entry, 0] < 0:
        filled[word] &= filled[word] - np.uint64(1)
    return entry, (at >> 14 << 14) + bucket


@inner_kernel
def put(queue: Queue, entry: int, at: int, row: int, col: int, g: int, key: int) -> None:
    """Put row, col, g and key into the queue as `entry`; `at` is the last key taken off."""
    first, filled, entries, state = queue.first, queue.filled, queue.entries, queue.state
    entries[entry, 1], entries[entry, 2], entries[entry, 3], entries[entry, 4] = row, col, g, key
    bucket = key & (KEYS - 1)
    if key >> 14 == at >> 14:
        filled[bucket >> 6] |= np.uint64(1) << np.uint64(bucket & 63)
    else:
        bucket = KEYS + (key >> 14)
        state[LAST] = max(state[LAST], key >> 14)
    entries[entry, 0] = first[bucket]
    first[bucket] = entry


@bare_kernel
def next_block(queue: Queue, at: int) -> int:
    """Spread the entries of the first nonempty block after that of the key `at` over its keys; return its first key, or -1.

    This turns the order of entries with equal keys round: `take` then returns the one that was added first.
    """
    first, filled, entries, last = queue.first, queue.filled, queue.entries, queue.state[LAST]
    block = (at >> 14) + 1
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
