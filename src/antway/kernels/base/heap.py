"""A 4-ary heap: `size` rows of key and item in an array [M, 2] of integers or of floats, the row of least key first."""

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
