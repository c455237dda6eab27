"""The queues of the searches: heaps, buckets, and the queue of D* Lite."""

from __future__ import annotations

import numpy as np
import pytest

from antway import Moves, Problem
from antway.kernels.base.heap import pop, pop_item, push, put_item
from antway.kernels.search.buckets import BLOCKS, KEYS, Queue, put, reset, take
from antway.kernels.search.dstarlite import SIZE
from antway.search.dstarlite import DStarLite
from common import cases, pick, solvable


def test_rows_leave_a_heap_in_order() -> None:
    """The first row is one of least key, and no row is lost; keys and items may occur several times."""
    rng = np.random.default_rng(1)
    for _ in range(cases(20, 500)):
        heap, size, rows = np.empty((64, 2)), 0, []
        for _ in range(300):
            if not size or (size < 64 and rng.random() < 0.55):
                rows.append((float(rng.integers(40)), float(rng.integers(5))))
                size = push(heap, size, *rows[-1])
            else:
                first = tuple(heap[0].tolist())
                assert first[0] == min(rows)[0]
                rows.remove(first)
                size = pop(heap, size)
            assert sorted(map(tuple, heap[:size].tolist())) == sorted(rows)


def test_items_leave_a_heap_in_order() -> None:
    """The item taken off has the least key of all, also after keys have decreased, and each knows its place."""
    rng = np.random.default_rng(2)
    for _ in range(cases(20, 500)):
        key, size = rng.integers(0, 99, 40).astype(float), 0
        heap, place = np.full((2, 40), -1, np.int32)
        for _ in range(300):
            if not size or rng.random() < 0.6:
                item = int(rng.integers(40))
                key[item] -= rng.integers(9)
                size = put_item(key, heap, place, size, item)
            else:
                least = key[place >= 0].min()
                item = pop_item(key, heap, place, size)
                size -= 1
                assert key[item] == least and place[item] == -1
                key[item] = rng.integers(99)
            assert (place >= 0).sum() == size and np.array_equal(place[heap[:size]], np.arange(size))


def test_entries_leave_buckets_in_order() -> None:
    """Of equal keys the last one added in the block of the key comes first, then those added before it, the oldest first."""
    rng = np.random.default_rng(3)
    first, filled = np.full(KEYS + BLOCKS, -1, np.int32), np.zeros(KEYS // 64, np.uint64)
    queue = Queue(first, filled, np.empty((300, 5), np.int32), np.zeros(7, np.int64))
    for _ in range(cases(30, 500)):
        reset(queue)  # of what the searches before it have left
        waiting: dict[int, list[int]] = {}
        at, entry, spread = -KEYS, 0, int(rng.choice([3, 200, 20_000, 200_000]))
        while entry < 300:
            if not waiting or rng.random() < 0.55:
                key = max(at, 0) + int(rng.integers(spread))
                put(queue, entry, at, 1, 2, 3, key)
                same = waiting.setdefault(key, [])
                same.insert(0 if key // KEYS == at // KEYS else len(same), entry)
                entry += 1
            else:
                found, at = take(queue, at)
                assert at == min(waiting) and found == waiting[at].pop(0)
                assert queue.entries[found, 1:].tolist() == [1, 2, 3, at]
                if not waiting[at]:
                    del waiting[at]
        if rng.random() < 0.5:
            left = sorted(key for key, same in waiting.items() for _ in same)
            for key in left:
                found, at = take(queue, at)
                assert at == key
            assert take(queue, at) == (-1, -1)


@pytest.mark.parametrize("moves", [Moves.FOUR, Moves.EIGHT])
def test_the_queue_of_dstarlite(moves: Moves) -> None:
    """Through changes and moves it is a heap of just the cells where g and rhs differ."""
    rng = np.random.default_rng(4)
    for _ in range(cases(15, 300)):
        grid = solvable(rng, low=2, high=16)
        start, goal = pick(rng, grid, 2)
        robot = DStarLite(Problem(grid, start, goal, moves))
        d = robot._search
        for _ in range(8):
            robot.plan()
            cells = np.argwhere(rng.random(grid.shape) < 0.1)
            cells = cells[(cells != start).any(axis=1) & (cells != goal).any(axis=1)]
            robot.change(cells, rng.random(len(cells)) < 0.5)
            queue = d.queue[: d.state[SIZE]]
            assert sorted(queue.tolist()) == np.flatnonzero(d.g != d.rhs).tolist()
            assert np.array_equal(d.place[queue], np.arange(len(queue))) and (d.place >= 0).sum() == len(queue)
            keys = [tuple(key) for key in d.key[queue].tolist()]
            assert all(keys[(i - 1) // 2] <= keys[i] for i in range(1, len(keys)))
