"""The Pareto front of (time, distance, clearance) of paths among moving obstacles.

In each period of time the robot moves to one of 8 neighbours or stands. A *label* describes a path to a cell at the end of a
period: its distance, and the smallest clearance. Labels that another label of the same cell and time dominates are
dropped. In `timed_front` ants extend labels, guided by a pheromone for each objective. `exact_front` extends every label,
period by period (dynamic programming), and is the reference for the ants.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, TooLarge
from antway.limits import MAX_SPEED
from antway.planning import Problem, Status, TimedPath
from antway.search.derived import graph
from antway.search.distance_field import distance_field
from antway.search.sipp import Trajectories, checked_trajectories

MOST = 1.0  # m; larger clearances count as this, unless it is said otherwise
OBJECTIVES = ("time", "distance", "clearance")
MAX_STATES = 2_000_000  # limit of cells times periods
LEVEL = 0.05  # m; clearances are rounded down to multiples of this
_SAME = 1e-9
_GREED = (0.5, 2.0, 8.0)  # 1 / periods; beta of successive ants
_PERSISTENCE = 0.9


class Label(NamedTuple):
    """A path to a cell."""

    cell: int  # flat
    distance: float  # m
    clearance: float  # m
    parent: int  # number of the label that this one extends; -1 for the start
    period: int  # at whose start the path arrives

    def dominates(self, other: Label) -> bool:
        """Tell whether this path is as good as another one in each objective, or better."""
        _, distance, clearance, _, period = self
        return period <= other[4] and distance <= other[1] + _SAME and clearance >= other[2] - _SAME


@dataclass(frozen=True, slots=True, eq=False)
class TimedFront:
    """Timed paths that do not dominate each other, by increasing time.

    Attributes
    ----------
    status : Status
        FOUND: the front is complete; NO_PATH: no path reaches the goal within the horizon; BUDGET: labels were left untried.
    values : float64[P, 3]
        Time in s, distance in m, and clearance in m: the smallest gap to a moving obstacle, in steps of 0.05 m up to `most`.
    paths : tuple of TimedPath
    labels : int
        Number of labels extended.
    """

    status: Status
    values: NDArray[np.float64]
    paths: tuple[TimedPath, ...]
    labels: int

    def least(self, distance_weight: float, clearance: float = 0.0) -> int:
        """Return the path with the least time plus `distance_weight` s for each m, among those with at least that clearance.

        Raises
        ------
        BadParameter
            If no path has that clearance.
        """
        checks.number("distance_weight", distance_weight, low=0.0, unit="s/m")
        wide = np.flatnonzero(self.values[:, 2] >= checks.number("clearance", clearance, low=0.0, unit="m") - _SAME)
        if not len(wide):
            raise BadParameter("clearance", clearance, "what a path of the front has")
        return int(wide[np.argmin(self.values[wide, 0] + distance_weight * self.values[wide, 1])])


class _Graph:
    """The moves of a disc on a grid in periods of equal length, and their gaps to the obstacles; see `timed_front`."""

    def __init__(
        self, problem: Problem, obstacles: Trajectories | None, radius: float, v_max: float, horizon: float, most: float
    ) -> None:
        grid, moves = checks.instance("problem", problem, Problem).grid, problem.moves
        if len(moves.offsets) > 8:
            raise BadParameter("problem.moves", moves.value, "to the 4 or 8 neighbours")
        radius = checks.number("radius", radius, low=0.0, unit="m")
        v_max = checks.number("v_max", v_max, low=1e-6, high=MAX_SPEED, unit="m/s")
        horizon = checks.number("horizon", horizon, low=0.0, open_low=True, high=1e5, unit="s")
        self.most = most = checks.number("most", most, low=0.0, high=1e6, unit="m")
        size = grid.resolution
        self.period = float(moves.lengths.max()) * size / v_max
        self.periods = int(min(horizon / self.period + _SAME, MAX_STATES + 1.0))
        rows, cols = grid.shape
        if rows * cols * max(self.periods, 1) > MAX_STATES:
            raise TooLarge("horizon", horizon, f"at most {MAX_STATES} cells times periods of {self.period:g} s")
        net = graph(grid, moves)
        legal = net.inner(net.legal).reshape(-1, 1) >> np.arange(len(moves.offsets)) & 1
        cell, move = np.nonzero(np.column_stack((legal, ~grid.blocked.ravel())))  # the last move of a cell is to stand there
        ends = np.column_stack((cell, cell + np.append(moves.offsets.astype(np.int64) @ (cols, 1), 0)[move]))
        lengths = (np.append(moves.lengths, 0.0) * size)[move].tolist()
        self.moves: dict[int, list[tuple[int, int, float]]] = {}  # for each cell: (index of the move, target cell, length)
        for i, (source, target) in enumerate(ends.tolist()):
            self.moves.setdefault(source, []).append((i, target, lengths[i]))
        self.centres = centres = grid.to_xy(np.column_stack(np.divmod(np.arange(rows * cols), cols)))
        self.radius = radius
        self.discs: list[tuple[NDArray[np.float64], NDArray[np.float64], float]] = []  # knot_t, knot_xy, radius
        if obstacles is not None:
            knot_t, knot_xy, first, radii = checked_trajectories(obstacles)
            knots = [slice(low, high) for low, high in pairwise(first.tolist())]
            self.discs = [(knot_t[own], knot_xy[own], r) for own, r in zip(knots, radii.tolist())]
        self.gap = np.empty((self.periods, len(ends)))
        for n in range(self.periods):
            self.gap[n] = self._gaps(centres[ends[:, 0]], centres[ends[:, 1]], n * self.period, (n + 1) * self.period)
        self.start = problem.start[0] * cols + problem.start[1]
        self.goal = problem.goal[0] * cols + problem.goal[1]
        self.clearance = most  # of a path without moves; the first move has the gap at its beginning in its own
        if self.start == self.goal:
            here = centres[[self.start]]
            self.clearance = float(self._gaps(here, here, 0.0, 0.0)[0])
        self.field = distance_field(grid, problem.goal, moves).ravel()
        back = scipy.sparse.csr_array((np.ones(len(ends)), (ends[:, 1], ends[:, 0])), shape=(rows * cols, rows * cols))
        # The least number of moves, and so of periods, from each cell to the goal without obstacles.
        self.least = scipy.sparse.csgraph.dijkstra(back, indices=[self.goal], unweighted=True)[0]

    def _gaps(self, a: NDArray[np.float64], b: NDArray[np.float64], t0: float, t1: float) -> NDArray[np.float64]:
        """Return the smallest gap of each move from a to b from t0 to t1, with the exact knots of the obstacles; rounded, m."""
        gap = np.full(len(a), self.most)
        for knot_t, knot_xy, r in self.discs:
            times = np.concatenate(([t0], knot_t[(knot_t > t0) & (knot_t < t1)], [t1]))
            places = np.column_stack([np.interp(times, knot_t, knot_xy[:, axis]) for axis in (0, 1)])
            for i in range(len(times) - 1):
                s0, s1 = (times[i] - t0) / self.period, (times[i + 1] - t0) / self.period
                p = a + (b - a) * s0 - places[i]
                d = a + (b - a) * s1 - places[i + 1] - p
                dd = (d * d).sum(axis=1)
                share = np.clip(-(p * d).sum(axis=1) / np.where(dd > 0.0, dd, 1.0), 0.0, 1.0)
                near = np.hypot(*(p + d * share[:, None]).T) - self.radius - r
                gap = np.minimum(gap, np.where(near < -_SAME, -math.inf, np.maximum(near, 0.0)))
        return np.floor(gap / LEVEL + 1e-6) * LEVEL

    def extended(self, label: Label, index: int) -> Iterator[tuple[int, Label]]:
        """Yield (move, label) for each extension of a label from which the goal can still be reached in time."""
        cell, distance, clearance, _, period = label
        if period >= self.periods:
            return
        gaps = self.gap[period]
        for move, there, length in self.moves[cell]:
            gap = float(gaps[move])
            if gap >= 0.0 and period + 1 + self.least[there] <= self.periods:
                yield move, Label(there, distance + length, min(clearance, gap), index, period + 1)


class _Known:
    """Labels that no other dominates, by cell and period, and the front of the labels at the goal."""

    def __init__(self, net: _Graph) -> None:
        self.net = net
        self.labels: list[Label] = [Label(net.start, 0.0, net.clearance, -1, 0)]
        self.at: dict[tuple[int, int], list[int]] = {(net.start, 0): [0]}
        self.front: list[int] = [0] if net.start == net.goal and net.clearance >= 0.0 else []

    def hopeless(self, label: Label) -> bool:
        """Tell whether a known path dominates or equals even the shortest completion of a label without obstacles."""
        cell, distance, clearance, parent, period = label
        periods, length = self.net.least[cell], float(self.net.field[cell])
        completed = Label(self.net.goal, distance + length, clearance, parent, period + periods)
        for i in self.front:  # noqa: SIM110 - most of the time is spent here, and a generator takes longer
            if self.labels[i].dominates(completed):
                return True
        return False

    def take(self, label: Label) -> int:
        """Keep a label unless another one dominates or equals it; return its number, or -1 if it is not kept."""
        labels, number = self.labels, len(self.labels)
        here = self.at.setdefault((label.cell, label.period), [])
        for i in here:
            if labels[i].dominates(label):
                return -1
        if self.hopeless(label):
            return -1
        here[:] = [i for i in here if not label.dominates(labels[i])]
        labels.append(label)
        here.append(number)
        if label.cell == self.net.goal:
            self.front = [*(i for i in self.front if not label.dominates(labels[i])), number]
        return number

    def stands(self, number: int) -> bool:
        """Tell whether no label dominates this one so far."""
        label = self.labels[number]
        return number in self.at[label.cell, label.period]

    def result(self, status: Status, extended: int) -> TimedFront:
        """Return the front."""
        order = sorted(self.front, key=lambda i: (self.labels[i].period, self.labels[i].distance))
        found = [self.labels[i] for i in order]
        values = [(one.period * self.net.period, one.distance, one.clearance) for one in found]
        if status is Status.FOUND and not order:
            status = Status.NO_PATH
        return TimedFront(status, np.array(values).reshape(-1, 3), tuple(self.path(i) for i in order), extended)

    def chain(self, number: int) -> list[Label]:
        """Return the labels from the start to the one with this number."""
        chain = []
        while number >= 0:
            chain.append(self.labels[number])
            number = self.labels[number].parent
        return chain[::-1]

    def path(self, number: int) -> TimedPath:
        """Return the motion that leads to a label."""
        chain = self.chain(number)
        t = np.array([label.period for label in chain], np.float64) * self.net.period
        return TimedPath(t, self.net.centres[[label.cell for label in chain]])


def exact_front(
    problem: Problem,
    obstacles: Trajectories | None = None,
    *,
    radius: float = 0.3,
    v_max: float = 1.0,
    horizon: float = 30.0,
    most: float = MOST,
) -> TimedFront:
    """Return the whole front by dynamic programming: every label is extended, period by period.

    Parameters and errors are those of `timed_front`.
    """
    net = _Graph(problem, obstacles, radius, v_max, horizon, most)
    known, extended = _Known(net), 0
    layer = [0]
    while layer:
        following = []
        for number in layer:
            if known.stands(number) and known.labels[number].cell != net.goal:
                extended += 1
                found = (known.take(label) for _, label in net.extended(known.labels[number], number))
                following += [i for i in found if i >= 0]
        layer = following
    return known.result(Status.FOUND, extended)


def timed_front(
    problem: Problem,
    obstacles: Trajectories | None = None,
    *,
    radius: float = 0.3,
    v_max: float = 1.0,
    horizon: float = 30.0,
    most: float = MOST,
    seed: int = 0,
    budget: int = 100_000,
) -> TimedFront:
    """Return timed paths that trade time, distance and clearance against one another, found by ants.

    Ants share a memory of labels. An ant starts from a label with untried moves and draws its moves by Eq. (1), with
    tau = sum of w_k tau_k over the objectives, where each ant draws its own w, and eta = exp(-beta * detour of the move). A new
    path on the front deposits on its moves, for each objective by its rank in it. Once no label has untried moves, the front is
    complete.

    Parameters
    ----------
    problem : Problem
        Its grid is inflated by the robot's radius, and its moves are to the 4 or 8 neighbours. The robot starts at time 0.
    obstacles : Trajectories or None
        The moving discs, such as `World.timeline(seed, horizon)`.
    radius, v_max : float
        Of the robot, m (>= 0) and m/s (>= 1e-6). A period is the time of the longest move.
    horizon : float
        Latest arrival, s, > 0.
    most : float
        More clearance than this has no value, m, in [0, 1e6].
    seed : int
    budget : int
        Labels that ants may extend, >= 1.

    Raises
    ------
    BadParameter, TooLarge

    Examples
    --------
    >>> from antway import Grid, World
    >>> from antway.world.motions import Line
    >>> from antway.world.world import Obstacle
    >>> grid = Grid(np.zeros((5, 7), dtype=bool))
    >>> crossing = World(grid, [Obstacle(0.3, Line((3.5, -1.0), (3.5, 6.0), 0.7))]).timeline(0, 30.0)
    >>> timed_front(Problem(grid, (2, 0), (2, 6)), crossing).values[0].round(2).tolist()
    [8.49, 6.83, 0.45]
    """
    net = _Graph(problem, obstacles, radius, v_max, horizon, most)
    checks.integer("budget", budget, low=1, high=100_000_000)
    rng = np.random.default_rng(np.random.SeedSequence(checks.seed(seed)))
    known, extended, ant = _Known(net), 0, 0
    tau: list[dict[int, float]] = [{}, {}, {}]  # for each objective the pheromone on moves; 1 if there is no entry
    untried: dict[int, list[tuple[int, Label]]] = {}
    waiting = [0]
    while waiting and extended < budget:
        weight = rng.dirichlet(np.ones(3))
        beta = _GREED[ant % len(_GREED)]
        at = int(rng.integers(len(waiting))) if rng.random() < 0.5 else len(waiting) - 1
        number = waiting[at]
        ant += 1
        while number >= 0 and extended < budget:
            label = known.labels[number]
            if label.cell == net.goal or not known.stands(number) or known.hopeless(label):
                untried[number] = []
                break
            if number not in untried:
                untried[number] = list(net.extended(label, number))
                extended += 1
            number = _walk(known, tau, untried[number], label, weight, beta, rng)
            if number >= 0:
                waiting.append(number)
                if known.labels[number].cell == net.goal:
                    _deposit(known, tau, number)
        waiting = [i for i in waiting if untried.get(i) != []] if ant % 64 == 0 or len(waiting) < 8 else waiting
        if at < len(waiting) and untried.get(waiting[at]) == []:
            waiting.pop(at)
    whole = not [i for i in waiting if untried.get(i) != [] and known.stands(i) and known.labels[i].cell != net.goal]
    return known.result(Status.FOUND if whole else Status.BUDGET, extended)


def _walk(
    known: _Known,
    tau: list[dict[int, float]],
    choices: list[tuple[int, Label]],
    label: Label,
    weight: NDArray[np.float64],
    beta: float,
    rng: np.random.Generator,
) -> int:
    """Draw moves by Eq. (1) until one leads to a label that is kept; return its number, or -1 if none does."""
    while choices:
        lost = [1.0 + known.net.least[there.cell] - known.net.least[label.cell] for _, there in choices]
        odds = np.array(
            [
                sum(w * trail.get(move, 1.0) for w, trail in zip(weight.tolist(), tau)) * math.exp(-beta * max(more, 0.0))
                for (move, _), more in zip(choices, lost)
            ]
        )
        total = float(odds.sum())
        drawn = int(rng.choice(len(choices), p=odds / total)) if total > 0.0 else 0
        number = known.take(choices.pop(drawn)[1])
        if number >= 0:
            return number
    return -1


def _deposit(known: _Known, tau: list[dict[int, float]], number: int) -> None:
    """Evaporate by Eq. (2), and deposit on a path to the goal for each objective by the rank of the path in it."""
    path = known.chain(number)
    costs = np.array([(one.period, one.distance, -one.clearance) for one in (known.labels[i] for i in known.front)])
    own = np.array([path[-1].period, path[-1].distance, -path[-1].clearance])
    for trail, rank in zip(tau, (costs < own - _SAME).mean(axis=0).tolist()):
        for move in trail:
            trail[move] = 1.0 + _PERSISTENCE * (trail[move] - 1.0)
        for one, other in pairwise(path):
            move = next(k for k, there, _ in known.net.moves[one.cell] if there == other.cell)
            trail[move] = trail.get(move, 1.0) + 1.0 - rank
