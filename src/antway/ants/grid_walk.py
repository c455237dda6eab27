"""The parts of every colony on a grid: the graph that the ants walk, the ants, and their pheromone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from antway.ants.immune import Immunity, scaled, vaccinate_path
from antway.ants.rules import Rule
from antway.errors import BadParameter, TooLarge
from antway.grid import Cell, Moves
from antway.kernels.colony import grid_walk as kernel
from antway.kernels.colony.pheromone import Numbers, limits
from antway.kernels.colony.pheromone import persistence as rho
from antway.kernels.search.best_first import Graph
from antway.kernels.search.distance_field import STRAIGHT
from antway.planning import Clock, Plan, Problem, Status
from antway.search.derived import graph, lattice
from antway.search.distance_field import DijkstraField, distance_field

STEPS = 1 << 18  # ant steps between two looks at the clock, about 10 ms
PART = 1 << 15  # cells processed between two looks at the clock, about 5 ms
MAX_CELLS = 1 << 22  # limit of cells; a colony needs about 200 bytes for each
NO_TURN = np.ones((9, 8), dtype=np.float32)
NO_PATH = np.empty(0, dtype=np.uint8)
ENDLESS = Clock(0.0, math.inf, None)


def parts(cells: int, clock: Clock) -> Iterator[slice]:
    """Divide a pass over all cells into parts; it ends early if the clock is spent."""
    for from_cell in range(0, cells, PART):
        if clock.spent():
            return
        yield slice(from_cell, min(from_cell + PART, cells))


@dataclass(frozen=True)
class AntGraph:
    """A problem as kernels use it: flat with a margin of one cell, and lengths in cells."""

    problem: Problem

    def __post_init__(self) -> None:
        if len(self.problem.moves.offsets) > 8:
            raise BadParameter("problem.moves", self.problem.moves.value, "four, eight, eight-nosqueeze or eight-cut for ants")
        if self.problem.grid.blocked.size > MAX_CELLS:
            raise TooLarge("grid.shape", self.problem.grid.shape, f"at most {MAX_CELLS} cells for ants (set a window)")

    @cached_property
    def net(self) -> Graph:
        """The legal moves of each cell."""
        return graph(self.problem.grid, self.problem.moves)

    @cached_property
    def offsets(self) -> NDArray[np.int64]:
        """Flat step of each move, int64[8]; 0 for moves that FOUR does not have."""
        return np.pad(self.net.offsets, (0, 8 - len(self.net.offsets)))

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        """Exact distance to the goal in cells, float64[N]; infinite where it cannot be reached."""
        return self.distance_from(self.problem.goal)

    def known(self, clock: Clock) -> bool:
        """Compute `distance`, unless the clock runs out; tell whether it is known."""
        grid = self.problem.grid
        search = DijkstraField(lattice(grid, self.problem.moves), [self.problem.goal], [])
        if search.run(clock):
            field = search.label.reshape(grid.shape) * (grid.resolution / STRAIGHT)
            self.__dict__["distance"] = self.flat(field / grid.resolution)
        return "distance" in self.__dict__

    @cached_property
    def for_kernels(self) -> kernel.GridGraph:
        """The record that kernels take."""
        return kernel.GridGraph(self.net.legal, self.offsets, Moves.EIGHT.lengths, self.start, self.goal)

    @property
    def start(self) -> int:
        """Flat index of the start."""
        return self.net.at(self.problem.start)

    @property
    def goal(self) -> int:
        """Flat index of the goal."""
        return self.net.at(self.problem.goal)

    @property
    def bound(self) -> float:
        """Length of the shortest path in cells."""
        return float(self.distance[self.start])

    def flat(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return float64[H, W, ...] flat, with an infinite margin."""
        edge = [(1, 1), (1, 1)] + [(0, 0)] * (values.ndim - 2)
        return np.pad(values, edge, constant_values=np.inf).reshape(-1, *values.shape[2:])

    def distance_from(self, cell: Cell) -> NDArray[np.float64]:
        """Return the exact distance to `cell` in cells, float64[N]."""
        problem = self.problem
        return self.flat(distance_field(problem.grid, cell, problem.moves) / problem.grid.resolution)

    def cells(self, path: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Return the flat cells of a path."""
        return self.start + np.concatenate(([0], np.cumsum(self.offsets[path])))

    def moves(self, cells: NDArray[np.integer]) -> NDArray[np.uint8]:
        """Return the moves of a path given by its flat cells; the inverse of `cells`."""
        found: NDArray[np.uint8] = np.argmax(np.diff(cells)[:, None] == self.offsets, axis=1).astype(np.uint8)
        return found

    def visibility(self, heuristic: str, beta: float, clock: Clock = ENDLESS) -> NDArray[np.float64]:
        """Return eta^beta of each legal move, float64[N, 8]; see `gridpath.explore` for the heuristics."""
        distance = self.distance
        if heuristic == "goal":
            rows, cols = np.divmod(np.arange(distance.size), self.net.width)
            distance = np.hypot(rows - self.goal // self.net.width, cols - self.goal % self.net.width)
        reachable = np.isfinite(self.distance)
        eta = np.zeros((distance.size, 8))
        detour = heuristic == "field"
        for part in parts(distance.size, clock):
            kernel.visibility(self.for_kernels, distance, reachable, beta, detour, part.start, part.stop, eta)
        return eta


class Ants:
    """Ants that walk at the same time. Threads share the ants, which affects only the time."""

    def __init__(self, graph: AntGraph, ants: int, limit: int, *, retreat: bool = True, threads: int = 1) -> None:
        self.graph, self.limit, self.retreat, self.threads = graph, limit, retreat, threads
        try:
            self.moves = np.empty((ants, limit), dtype=np.uint8)
        except MemoryError:
            raise TooLarge("ants * step_limit", ants * limit, "at most as many as fit into memory") from None
        self.depth = np.full(ants, -1, dtype=np.int32)
        self.length = np.full(ants, np.inf)
        self._stamps = [np.zeros(graph.distance.size, dtype=np.int32) for _ in range(threads)]
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool:
            self._pool.shutdown()

    def walk(
        self,
        weights: NDArray[np.float32],
        seed: int,
        first: int,
        clock: Clock,
        *,
        greedy: float = 0.0,
        turn: NDArray[np.float32] = NO_TURN,
    ) -> int:
        """Let the ants first, first + 1, ... walk, measure their paths, and return the number of steps.

        See `kernels.colony.grid_walk.walk`. No ant starts once the clock is spent; ants that did not start count as dead.
        """
        ants, graph = self.depth.size, self.graph
        block = max(1, min(STEPS // max(self.limit, 1), -(-ants // self.threads)))

        def walk_rows(worker: int) -> int:
            steps = 0
            for from_cell in range(worker * block, ants, self.threads * block):
                part = slice(from_cell, from_cell + block)
                self.depth[part] = -1
                if not clock.spent():
                    steps += kernel.walk(
                        graph.for_kernels, weights, self.retreat, greedy, turn, np.uint64(seed), first + from_cell,
                        self.moves[part], self.depth[part], self._stamps[worker],
                    )  # fmt: skip
            return steps

        steps = sum((self._pool.map if self._pool else map)(walk_rows, range(self.threads)))
        kernel.measure(self.moves, self.depth, self.length)
        return steps

    def path(self, ant: int) -> NDArray[np.uint8]:
        """Return the moves of an ant that arrived."""
        return self.moves[ant, : self.depth[ant]].copy()


class Trail:
    """Pheromone on the moves of a graph, and the best path so far, as a rule updates them.

    For each move `tau` is the pheromone and `eta` the heuristic to the power beta, float64[N, 8], 0 if it is not legal. `tau_0`
    is the initial pheromone, `tau_min` and `tau_max` its limits on legal moves. `best` is the length of `path` in cells,
    infinite if there is none. Once the clock is spent only these two are valid: passes over the map are left unfinished.
    """

    def __init__(self, graph: AntGraph, rule: Rule, ants: int, heuristic: str, clock: Clock = ENDLESS) -> None:
        self.graph, self.numbers, self.clock = graph, rule.numbers(ants), clock
        self.eta = eta = graph.visibility(heuristic, self.numbers.beta, clock)
        self.best, self.path = math.inf, NO_PATH
        self._improved = self._restarted = -1  # cycle of the last improvement, and of the last restart
        self._weights = np.zeros(eta.shape, np.float32)
        moves = cells = 0
        for part in parts(len(eta), clock):
            moves += int(np.count_nonzero(eta[part]))
            cells += int(np.count_nonzero(eta[part].any(axis=1)))
        self._choices = self.numbers.choices or moves / max(cells, 1)
        self.tau_min, self.tau_max = self._limits()
        limited = self.numbers.p_best > 0
        self.tau_0 = self.tau_max if limited else rule.initial(ants, max(round(graph.bound), 1), graph.bound)
        self.tau = np.zeros(eta.shape)
        for part in parts(len(eta), clock):
            self.tau[part] = np.where(eta[part] > 0, min(max(self.tau_0, self.tau_min), self.tau_max), 0.0)

    def weights(self) -> NDArray[np.float32]:
        """Return tau^alpha eta^beta, Eq. (1), float32[N, 8]; the array is overwritten at the next call."""
        for part in parts(len(self.tau), self.clock):
            kernel.weigh(self.tau[part], self.eta[part], self.numbers.alpha, self._weights[part])
        return self._weights

    def learn(self, walkers: Ants, t: int, immunity: Immunity | None = None) -> None:
        """Update the best path and, by Eq. (2), the pheromone with the paths of cycle `t` (0, 1, ...)."""
        numbers = self.numbers if immunity is None else self._immunise(walkers, t, immunity)
        order = np.argsort(walkers.length, kind="stable")
        if walkers.length[order[0]] < self.best:
            self.best, self.path, self._improved = float(walkers.length[order[0]]), walkers.path(int(order[0])), t
            self.tau_min, self.tau_max = self._limits()
        if self.clock.spent():
            return
        pheromone = kernel.Pheromone(self.tau, self.eta, self.tau_0, self.tau_min, self.tau_max)
        paths = kernel.Paths(walkers.moves, walkers.depth, walkers.length)
        since = t - self._restarted - 1
        kernel.update(self.graph.for_kernels, numbers, pheromone, paths, order, self.path, self.best, since)
        if self.numbers.restart and t - max(self._improved, self._restarted) >= self.numbers.restart:
            self._restarted = t
            self.tau[self.eta > 0] = self.tau_max

    def _immunise(self, walkers: Ants, t: int, immunity: Immunity) -> Numbers:
        """Apply the immune operator to the paths; return the rule with deposits scaled by concentration."""
        graph = self.graph
        arrived = np.flatnonzero(walkers.depth >= 0)
        if len(arrived) == 0:
            return self.numbers
        paths, costs, scale = immunity.respond(
            t,
            [graph.cells(walkers.path(int(ant))) for ant in arrived],
            walkers.length[arrived],
            lambda cells: length_of(graph.moves(cells)) if len(cells) <= walkers.limit + 1 else math.inf,
            vaccinate_path,
        )
        for ant, cells in zip(arrived, paths):
            walkers.depth[ant] = len(cells) - 1
            walkers.moves[ant, : len(cells) - 1] = graph.moves(cells)
        walkers.length[arrived] = costs
        if self.best < math.inf and immunity.suppresses(t - self._improved):
            self.tau[graph.cells(self.path)[:-1], self.path] *= immunity.policy.suppression
        factor = np.zeros(walkers.depth.size)
        factor[arrived] = scale
        return scaled(self.numbers, walkers.length, factor)

    def _limits(self) -> tuple[float, float]:
        """Return the limits of pheromone."""
        if self.numbers.p_best == 0:
            return kernel.LOW, kernel.HIGH
        strongest = rho(self.numbers.persistence_rule, 1.0, 0.0, 0, 0.0)
        length = self.best if self.best < math.inf else self.graph.bound
        return limits(self.numbers, strongest, length, max(round(length), 1), self._choices)


def length_of(path: NDArray[np.uint8]) -> float:
    """Return the length of a path given by its moves, in cells."""
    diagonals = int((path > 3).sum())
    return path.size - diagonals + diagonals * math.sqrt(2.0)


def plan_of(problem: Problem, status: Status, path: NDArray[np.uint8] | None, bound: float, steps: int, clock: Clock) -> Plan:
    """Return the plan of a path given by its moves from the start (None for no path); `bound` is in cells."""
    resolution = problem.grid.resolution
    bound *= resolution
    if path is None:
        return Plan(status, expanded=steps, elapsed=clock.elapsed(), lower_bound=bound)
    cells = np.vstack((problem.start, problem.start + np.cumsum(problem.moves.offsets[path], axis=0))).astype(np.int32)
    length = length_of(path) * resolution
    optimal = length <= bound * (1 + 1e-9)
    return Plan(status, cells, length, optimal, steps, clock.elapsed(), lower_bound=length if optimal else bound)
