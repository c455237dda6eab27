"""Slow, obvious twins of the search kernels: plain loops over cells and a textbook heap."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from functools import cache

import numpy as np

from antway import Grid, Moves

Cell = tuple[int, int]
SIDES_NEEDED = {Moves.EIGHT: 2, Moves.EIGHT_NOSQUEEZE: 1, Moves.EIGHT_CUT: 0}
DIRECTIONS = [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)]
LONG = {Moves.SIXTEEN: {(1, 2)}, Moves.THIRTY_TWO: {(1, 2), (1, 3), (2, 3)}}


def steps(grid: Grid, moves: Moves, cell: Cell) -> Iterator[tuple[Cell, float]]:
    """Yield the cells one legal move from `cell`, and the length of the move in cells."""
    r, c = cell
    for dr, dc in all_moves(moves):
        if grid.is_free((r + dr, c + dc)) and passes(grid, moves, r, c, dr, dc):
            yield (r + dr, c + dc), math.hypot(dr, dc)


@cache
def all_moves(moves: Moves) -> list[Cell]:
    """The rows and columns by which each move leads on."""
    return [(dr, dc) for dr in range(-3, 4) for dc in range(-3, 4) if is_move(moves, dr, dc)]


def is_move(moves: Moves, dr: int, dc: int) -> bool:
    """Tell whether `moves` has that move at all."""
    a, b = sorted((abs(dr), abs(dc)))
    return (a, b) == (0, 1) or ((a, b) == (1, 1) and moves is not Moves.FOUR) or (a, b) in LONG.get(moves, ())


def passes(grid: Grid, moves: Moves, r: int, c: int, dr: int, dc: int) -> bool:
    """Tell whether what a move passes is free: the side cells of a diagonal, what the segment of a long move touches."""
    if abs(dr) + abs(dc) == 1:
        return True
    if moves in SIDES_NEEDED:
        return grid.is_free((r + dr, c)) + grid.is_free((r, c + dc)) >= SIDES_NEEDED[moves]
    samples = [(r + dr * t / 24, c + dc * t / 24) for t in range(25)]  # 24 divides so that every corner is hit exactly
    return all(
        grid.is_free((row, col))
        for y, x in samples
        for row in {math.floor(y + 0.5), math.ceil(y - 0.5)}
        for col in {math.floor(x + 0.5), math.ceil(x - 0.5)}
    )


def field(grid: Grid, goals: list[Cell], moves: Moves, costs: np.ndarray | None = None) -> np.ndarray:
    """Distance in m from every cell to the nearest goal by Dijkstra with a heap."""
    distance = np.full(grid.shape, np.inf)
    heap = [(0.0, goal) for goal in goals]
    while heap:
        d, cell = heapq.heappop(heap)
        if d >= distance[cell]:
            continue
        distance[cell] = d
        for to, length in steps(grid, moves, cell):
            weight = 1.0 if costs is None else (costs[cell] + costs[to]) / 2
            heapq.heappush(heap, (d + length * weight * grid.resolution, to))
    return distance


def surroundings(grid: Grid) -> np.ndarray:
    """Which of the 8 neighbours of each free cell are free, bit d for direction d."""
    around = np.zeros(grid.shape, np.uint8)
    for r in range(grid.shape[0]):
        for c in range(grid.shape[1]):
            if grid.is_free((r, c)):
                around[r, c] = sum(1 << d for d, (dr, dc) in enumerate(DIRECTIONS) if grid.is_free((r + dr, c + dc)))
    return around


def canonical(bits: int, came: int, moves: Moves) -> set[int]:
    """Canonical successors of the middle of a 3 x 3 map: those to which no way round the middle is shorter or, as long, has its
    diagonal (4 moves: its vertical move) first."""
    blocked = np.zeros((3, 3), bool)
    for d, (dr, dc) in enumerate(DIRECTIONS):
        blocked[1 + dr, 1 + dc] = not bits >> d & 1
    dr, dc = DIRECTIONS[came]
    before = (1 - dr, 1 - dc)
    blocked[before] = False
    grid = Grid(blocked)
    kept = set()
    for d, (dr, dc) in enumerate(DIRECTIONS):
        end = (1 + dr, 1 + dc)
        through = dict(steps(grid, moves, (1, 1))).get(end)
        if through is None or end == before:
            continue
        first = math.hypot(*DIRECTIONS[came])
        paths = [(length, [length]) for to, length in steps(grid, moves, before) if to == end]
        for middle, one in steps(grid, moves, before):
            paths += [(one + two, [one, middle]) for to, two in steps(grid, moves, middle) if to == end and middle != (1, 1)]
        beaten = False
        for total, path in paths:
            if total < first + through - 1e-9:
                beaten = True
            elif total < first + through + 1e-9:
                beaten |= path[1][1] == before[1] if moves is Moves.FOUR else path[0] > first
        if not beaten:
            kept.add(d)
    return kept


def jump(grid: Grid, cell: Cell, d: int) -> int:
    """How far off in straight direction d the next jump point is, or, negated, the next wall if that comes first."""
    (r, c), (dr, dc) = cell, DIRECTIONS[d]
    for k in range(1, sum(grid.shape) + 2):
        r, c = r + dr, c + dc
        if not grid.is_free((r, c)):
            return -k
        for side in (-1, 1):
            if grid.is_free((r + side * dc, c + side * dr)) and not grid.is_free((r - dr + side * dc, c - dc + side * dr)):
                return k
    raise AssertionError("a line has an end")


def is_corner(grid: Grid, cell: Cell) -> bool:
    """Tell whether a cell is free, with a blocked cell diagonally between two free sides."""
    r, c = cell
    return grid.is_free(cell) and any(
        grid.is_free((r + dr, c)) and grid.is_free((r, c + dc)) and not grid.is_free((r + dr, c + dc))
        for dr in (-1, 1)
        for dc in (-1, 1)
    )


def sees(grid: Grid, one: Cell, other: Cell) -> bool:
    """Tell whether the diagonal and straight moves of an empty map are legal in any order, and pass no corner."""
    dr, dc = other[0] - one[0], other[1] - one[1]
    row, col = (dr > 0) - (dr < 0), (dc > 0) - (dc < 0)
    diagonals, straights = min(abs(dr), abs(dc)), abs(abs(dr) - abs(dc))
    straight = (row, 0) if abs(dr) > abs(dc) else (0, col)
    cells = {
        (one[0] + i * row + j * straight[0], one[1] + i * col + j * straight[1])
        for i in range(diagonals + 1)
        for j in range(straights + 1)
    }
    if any(not grid.is_free(cell) or (cell not in (one, other) and is_corner(grid, cell)) for cell in cells):
        return False
    return all(passes(grid, Moves.EIGHT, r, c, row, col) for r, c in cells if diagonals and (r + row, c + col) in cells)
