"""4-ary heaps. The order in which items of equal key come out depends on the order of calls.

`push` and `pop` keep `size` rows (key, item) in an array [M, 2], the row of least key first; an item may occur several times.
`put_item` and `pop_item` keep each of the items 0, 1, ... at most once in `heap`, ordered by `key[item]`; `place[item]` is its
position, or -1.

search/dstarlite, spacetime/sipp and spacetime/memory have binary heaps of their own, with pairs of keys or other arrays. A
4-ary heap would take equal keys in another order and so change their answers.
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
    while 4 * hole + 1 < size:
        least = 4 * hole + 1
        for other in range(least + 1, min(least + 4, size)):
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
    """Put `item` on the heap, or move it up because its key has decreased; return the new size."""
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
        while 4 * hole + 1 < size:
            least = 4 * hole + 1
            for other in range(least + 1, min(least + 4, size)):
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
