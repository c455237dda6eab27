"""What ants add: each ant method compared with its twins without pheromone or without ants, on the same seeds and budget."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from antway import checks
from antway.ants.gridpath import explore
from antway.ants.rules import AntColonySystem, MaxMinAntSystem
from antway.ants.tsp import MMAS_WITH_SEARCH, Tsp, solve_tsp
from antway.arena.suites import seed_of
from antway.grid import Grid
from antway.planning import Budget, Problem, Status, solve
from antway.policies.antway.control_options import ControlOptions
from antway.policies.antway.policy import AntwayPolicy
from antway.scenes import SCENES
from antway.tours.windowed import Path, search
from antway.world.episode import run
from antway.world.policy import Policy, Task
from antway.world.robots import load_robot
from antway.world.scenario import Scenario, load_scenario

TWINS = ("ants", "no pheromone", "argmin", "exact")
_TURNS = 3  # limit of episodes of a scene for robots with inertia, which take long
Drivers = tuple[str | Policy | None, ...]  # for each of TWINS


@dataclass(frozen=True, slots=True)
class Comparison:
    """One method and its twins.

    Values are means for each of `TWINS`: the ants; the same without pheromone, where only the heuristic guides their random
    choices; always the best choice by the heuristic, without chance; exact search. A mean is NaN if there is no such twin, and
    infinite if it failed in a run.
    """

    method: str  # what was solved, and with which budget
    unit: str  # of the means; less is better
    runs: int
    values: tuple[tuple[str, float], ...]  # twin and mean


def compare(parts: tuple[str, ...] | None = None, *, runs: int = 10) -> Iterator[Comparison]:
    """Run each method and its twins, and yield the comparison.

    Parameters
    ----------
    parts : tuple of str or None
        Any of grid, tsp, tsptw, paper, antway, controls; None: all.
    runs : int
        Number of problems, or of episodes of each scene; seeds depend only on their names.

    Examples
    --------
    >>> [one.method for one in compare(("grid",), runs=1)]
    ['grid: 30 x 30, 20 % blocked, 30 ants x 20 cycles']
    """
    checks.integer("episodes", runs, low=1, high=1000)
    for part in PARTS if parts is None else parts:
        yield from PARTS[checks.choice("parts", part, PARTS)](runs)


def markdown(rows: list[Comparison]) -> str:
    """Return the comparisons as a table in Markdown."""
    lines = ["| method, budget | mean | ants | no pheromone | argmin | exact |", "|---|---|--:|--:|--:|--:|"]
    for row in rows:
        cells = ["–" if math.isnan(value) else f"{value:.2f}" for _, value in row.values]
        lines.append(f"| {row.method} | {row.unit}; {row.runs} runs | {' | '.join(cells)} |")
    return "\n".join(lines)


def _row(method: str, unit: str, table: list[list[float]]) -> Comparison:
    """Return the means of a table with a row for each run and a column for each twin."""
    return Comparison(method, unit, len(table), tuple(zip(TWINS, np.mean(np.array(table), axis=0).tolist())))


def _over(values: Iterable[float], least: float) -> list[float]:
    """Return by how many % each value is above the least one."""
    return [100.0 * (value / least - 1.0) for value in values]


def _grid(runs: int) -> Iterator[Comparison]:
    """Compare the paper's colony, eta = 1 / d, on random maps."""
    table: list[list[float]] = []
    number = 0
    while len(table) < runs:
        seed = seed_of("ants", "grid", number)
        number += 1
        blocked = np.random.default_rng(seed).random((30, 30)) < 0.2
        blocked[0, 0] = blocked[-1, -1] = False
        problem = Problem(Grid(blocked), (0, 0), (29, 29))
        exact = solve(problem, "dijkstra")
        if exact.status is not Status.FOUND:
            continue
        found = [
            explore(problem, seed=seed, heuristic="goal", ants=30, cycles=20, alpha=alpha, beta=beta).plan.length
            for alpha, beta in ((1.0, 7.0), (0.0, 7.0), (0.0, 100.0))
        ]
        table.append(_over([*found, exact.length], exact.length))
    yield _row("grid: 30 x 30, 20 % blocked, 30 ants x 20 cycles", "% over the shortest", table)


def _tsp(runs: int) -> Iterator[Comparison]:
    """Compare MMAS on random cities, without and with 3-opt; the best of all answers replaces the optimum."""
    plain: list[list[float]] = []
    improved: list[list[float]] = []
    for number in range(runs):
        seed = seed_of("ants", "tsp", number)
        problem = Tsp(np.random.default_rng(seed).random((200, 2)) * 1000.0)
        rules = MaxMinAntSystem(), MaxMinAntSystem(alpha=0.0), AntColonySystem(alpha=0.0, q0=1.0)
        short = [solve_tsp(problem, rule, tours=20_000, seed=seed).length for rule in rules]
        searching = MMAS_WITH_SEARCH, replace(MMAS_WITH_SEARCH, alpha=0.0)
        options = {"local_search": "3opt", "focused": False, "tours": 500, "seed": seed}
        best = [solve_tsp(problem, rule, **options).length for rule in searching]  # type: ignore[arg-type]
        least = min(*short, *best, solve_tsp(problem, "mmas", local_search="3opt", tours=4_000, seed=seed).length)
        plain.append([*_over(short, least), math.nan])
        improved.append([*_over(best, least), math.nan, math.nan])
    yield _row("TSP: 200 cities, MMAS, 20,000 tours", "% over the best known", plain)
    yield _row("TSP: 200 cities, MMAS with 3-opt, 500 tours", "% over the best known", improved)


def _tsptw(runs: int) -> Iterator[Comparison]:
    """Compare the colony for time windows on random stops; without beams only random moves and local search remain."""
    table = []
    for number in range(runs):
        seed = seed_of("ants", "tsptw", number)
        rng = np.random.default_rng(seed)
        xy = rng.random((81, 2)) * 100.0
        xy[-1] = xy[0]
        time = np.ceil(np.hypot(*(xy[:, None] - xy).transpose(2, 0, 1)))
        visit = np.concatenate(([0.0], np.cumsum([time[a, a + 1] for a in range(80)])))  # in this order all stops are in time
        opens, closes = np.maximum(visit - rng.integers(0, 400, 81), 0.0), visit + rng.integers(1, 400, 81)
        opens[0], closes[0], opens[-1], closes[-1] = 0.0, 1e6, 0.0, 1e6
        path = Path(time, opens.astype(np.float64), closes.astype(np.float64))
        costs = []
        for evaporation, width in ((0.1, 30), (0.0, 30), (0.1, 0)):
            found = search(path, Budget(seconds=60.0).start(), cycles=10, seed=seed, evaporation=evaporation, width=width)
            late = found.late > 0.0
            costs.append(math.inf if late else float(time[found.order[:-1], found.order[1:]].sum()))
        table.append([*_over(costs, min(costs)), math.nan])
    yield _row("TSPTW: 80 stops, 10 cycles; argmin: shaking alone", "% over the best of them", table)


def _driven(method: str, scenario: Scenario, drivers: Drivers, runs: int, name: str) -> Comparison:
    """Compare the times to the goal, s; infinite if it is not reached."""
    table = []
    for number in range(runs):
        times = []
        for policy in drivers:
            result = None if policy is None else run(scenario, policy, seed=seed_of("ants", name, number), record=False)
            times.append(math.nan if result is None else result.time if result.reached else math.inf)
        table.append(times)
    return _row(method, "s to the goal", table)


def _paper(runs: int) -> Iterator[Comparison]:
    """Compare policy `paper`; exact: ants that know the exact field and so take the shortest path in their first cycle."""
    drivers = "paper", "paper/alpha=0.0", "paper/alpha=0.0/beta=100.0", "paper/heuristic=field"
    for name in SCENES:
        yield _driven(f"policy paper, scene {name}", load_scenario(name), drivers, runs, name)


class _Argmin(AntwayPolicy):
    """The search in space and time that always takes the most promising move of the most promising state."""

    def reset(self, task: Task, seed: int) -> None:
        """Begin an episode, in which no choice is random."""
        super().reset(task, seed)
        assert self.state is not None
        settings = self.state.settings
        colony = settings.colony._replace(betas=np.array([1e6]), slack=np.zeros(1), amount=0.0)
        self.state.settings = settings._replace(colony=colony)


def _antway(runs: int) -> Iterator[Comparison]:
    """Compare policy `antway`; exact: policy `sipp`, which replans in each cycle and has no guard."""
    drivers: Drivers = "antway", "antway/deposit=0.0", _Argmin(), "sipp"
    for name in SCENES:
        yield _driven(f"policy antway, scene {name}", load_scenario(name), drivers, runs, name)


def _controls(runs: int) -> Iterator[Comparison]:
    """Compare the colony in the space of controls, which drives wheels; argmin: the best of its seeds, without ants."""
    searches = ControlOptions(search="random"), ControlOptions(rounds=0)
    drivers: Drivers = "antway", *(AntwayPolicy(controls=options) for options in searches), None
    scenario = load_scenario("warehouse").driven_by(load_robot("diff"))
    yield _driven("controls of robot diff, scene warehouse", scenario, drivers, min(runs, _TURNS), "diff")


PARTS: dict[str, Callable[[int], Iterator[Comparison]]] = {
    "grid": _grid,
    "tsp": _tsp,
    "tsptw": _tsptw,
    "paper": _paper,
    "antway": _antway,
    "controls": _controls,
}
