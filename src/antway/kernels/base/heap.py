"""4-ary heaps, of rows or of items that know their places. Which of equal keys comes first depends on the order of calls.

`push` and `pop` keep `size` rows of key and item in an array [M, 2] of integers or of floats, the row of least key first. An
item may be there more than once. `put_item` and `pop_item` keep items 0, 1, ... in `heap`, each once, by the least of `key`;
`place` says where each is, -1: not there.

Three searches have binary heaps of their own, by pairs of keys or with arrays of their own: search/dstarlite, spacetime/sipp
and spacetime/memory. A 4-ary heap takes equal keys in another order, so that their answers would not be the same bytes.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel

Rows = NDArray[Any]


@bare_kernel
def push(heap: Rows, size: int, key: float, item: int) -> int:
    """Put `item` on the heap; return the new size."""
    hole = size
    while hole > 0:
        above = (hole - 1) >> 2
        if heap[above, 0] <= key:
            break
        heap[hole, 0], heap[hole, 1] = heap[above, 0], heap[above, 1]
        hole = above
    heap[hole, 0], heap[hole, 1] = key, item
    return size + 1


@bare_kernel
def pop(heap: Rows, size: int) -> int:
    """Take the first row off the heap; return the new size."""
    size -= 1
    key, item = heap[size, 0], heap[size, 1]
    hole = 0
    while True:
        child = 4 * hole + 1
        if child >= size:
            break
        least = child
        for other in range(child + 1, min(child + 4, size)):
            if heap[other, 0] < heap[least, 0]:
                least = other
        if heap[least, 0] >= key:
            break
        heap[hole, 0], heap[hole, 1] = heap[least, 0], heap[least, 1]
        hole = least
    heap[hole, 0], heap[hole, 1] = key, item
    return size


@bare_kernel
def put_item(key: Rows, heap: Rows, place: Rows, size: int, item: int) -> int:
    """Put `item` on the heap, or raise it there because its key has fallen; return the new size."""
    hole = place[item]
    if hole < 0:
        hole = size
        size += 1
    while hole > 0:
        above = (hole - 1) >> 2
        if key[heap[above]] <= key[item]:
            break
        heap[hole] = heap[above]
        place[heap[hole]] = hole
        hole = above
    heap[hole] = item
    place[item] = hole
    return size


@bare_kernel
def pop_item(key: Rows, heap: Rows, place: Rows, size: int) -> int:
    """Take the item of least key off the heap of `size` items and return it."""
    top: int = heap[0]
    place[top] = -1
    size -= 1
    if size > 0:
        moved = heap[size]
        hole = 0
        while True:
            child = 4 * hole + 1
            if child >= size:
                break
            least = child
            for other in range(child + 1, min(child + 4, size)):
                if key[heap[other]] < key[heap[least]]:
                    least = other
            if key[heap[least]] >= key[moved]:
                break
            heap[hole] = heap[least]
            place[heap[hole]] = hole
            hole = least
        heap[hole] = moved
        place[moved] = hole
    return top
