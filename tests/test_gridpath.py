"""Ants as a planner on grids: legal, honest about optimality, repeatable, and stopped when they should be."""

from __future__ import annotations

import json
import math
import threading

import numpy as np
import pytest

from antway.ants import grid_walk as walkers
from antway.ants.gridpath import ants, explore
from antway.ants.immune import Immune
from antway.ants.persistence import Adaptive, Constant, Printed
from antway.ants.rules import RULES, AntColonySystem, MaxMinAntSystem
from antway.errors import BadInput, BadParameter, TooLarge
from antway.grid import Grid, Moves
from antway.planning import Budget, Plan, Problem, Status
from antway.search.distance_field import distance_field
from antway.verify import check_plan
from common import SHARED, cases, free_cells, needs_data, random_grid

ANT_MOVES = [Moves.FOUR, Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT]


def shared_problem(name: str, moves: Moves) -> Problem:
    rows = (SHARED / "grids" / f"{name}.txt").read_text().split()
    grid = Grid(np.array([[cell == "@" for cell in row] for row in rows]))
    return Problem(grid, (0, 0), (grid.shape[0] - 1, grid.shape[1] - 1), moves)


def random_problem(rng: np.random.Generator) -> Problem:
    while True:
        grid = random_grid(rng, 2, 24, (0.0, 0.5))
        cells = free_cells(grid)
        if len(cells):
            start, goal = rng.choice(cells, 2)
            return Problem(grid, tuple(map(int, start)), tuple(map(int, goal)), ANT_MOVES[rng.integers(4)])


def scattered(rng: np.random.Generator, size: int, share: float) -> Grid:
    """A square grid with a share of its cells blocked, but not the two corners."""
    blocked = rng.random((size, size)) < share
    blocked[0, 0] = blocked[-1, -1] = False
    return Grid(blocked)


def same(a: Plan, b: Plan) -> bool:
    numbers = [(p.status, p.length, p.optimal, p.expanded, p.lower_bound, p.cells.tobytes()) for p in (a, b)]
    return numbers[0] == numbers[1]


@needs_data
@pytest.mark.parametrize("rule", ["nocut", "nosqueeze"])
def test_default_ants_find_the_optimum_of_the_shared_grids(rule):
    """On all six grids, 30 seeds each: the length of the exhaustive search, by cycle 5 at the latest."""
    moves = {"nocut": Moves.EIGHT, "nosqueeze": Moves.EIGHT_NOSQUEEZE}[rule]
    optima = json.loads((SHARED / "grids" / "optima.json").read_text())["optimum"]
    for name, lengths in optima.items():
        problem = shared_problem(name, moves)
        for seed in range(30):
            plan = ants(problem, seed=seed, cycles=5)
            check_plan(problem, plan)
            assert plan.length == pytest.approx(lengths[rule][0], abs=1e-4) and plan.optimal


@needs_data
def test_plain_ant_system_finds_short_paths_by_pheromone_alone():
    """By the straight distance to the goal alone, where no exact field leads them, ants come within 2 % in the median."""
    problem = shared_problem("iq30", Moves.EIGHT_NOSQUEEZE)
    runs = [explore(problem, seed=s, rule="as", persistence=Constant(0.7), heuristic="goal", retreat=False) for s in range(10)]
    assert np.median([run.plan.gap for run in runs]) < 0.02
    first, last = (np.nanmean([run.history[c, 1] for run in runs]) for c in (0, -1))  # NaN: none of them arrived
    assert last < 0.8 * first


def test_answers_are_legal_and_honest_on_any_map():
    """Every plan passes check_plan, NO_PATH is said exactly where there is none, and optimal only at the exact length."""
    rng = np.random.default_rng(7)
    rules, heuristics = list(RULES), ["field", "distance", "goal"]
    for i in range(cases(150, 5000)):
        problem = random_problem(rng)
        exact = distance_field(problem.grid, problem.goal, problem.moves)[problem.start]
        plan = ants(
            problem,
            seed=i,
            rule=rules[i % 5],
            heuristic=heuristics[i % 3],
            cycles=4,
            ants=8,
            retreat=bool(i % 2),
            beta=float(i % 7),
        )
        check_plan(problem, plan)
        assert (plan.status is Status.NO_PATH) == math.isinf(exact)
        if math.isfinite(exact):
            assert plan.length >= exact * (1 - 1e-9) and plan.lower_bound == pytest.approx(exact, rel=1e-9)
            assert plan.optimal == (plan.length <= exact * (1 + 1e-9))


def test_local_ants_find_a_short_way_round_what_closes_their_window():
    """As policy `paper` asks them: at most 1.25 times the exact detour in 95 % of the windows, and legal in all (C13)."""
    rng = np.random.default_rng(13)
    short = asked = 0
    while asked < cases(200, 2000):
        grid = random_grid(rng, 12, 40, (0.0, 0.25))
        window = tuple(int(v) for v in (*rng.integers(0, 4, 2), *rng.integers(6, 1 + min(grid.shape) - 3, 2)))
        row, col, rows, cols = window
        inside = np.zeros(grid.shape, dtype=bool)
        inside[row : row + rows, col : col + cols] = True
        there = np.argwhere(inside & ~grid.blocked)
        if len(there) < 2:
            continue
        start, goal = (tuple(map(int, there[i])) for i in rng.choice(len(there), 2, replace=False))
        rr, cc = np.indices(grid.shape)
        forbidden = np.zeros(grid.shape, dtype=bool)
        for r, c, radius in zip(*rng.uniform(0.0, 40.0, (2, 8)), rng.uniform(0.5, 4.0, 8)):
            forbidden |= (rr - r) ** 2 + (cc - c) ** 2 <= radius**2
        forbidden[start] = forbidden[goal] = False
        found = explore(
            Problem(grid, start, goal),
            seed=asked,
            persistence=Adaptive(),
            ants=30,
            cycles=20,
            stop_at_bound=True,
            window=window,
            forbidden=forbidden,
        )
        room = Problem(Grid(grid.blocked | forbidden | ~inside), start, goal)  # what the window leaves, as a map of its own
        exact = distance_field(room.grid, goal)[start]
        check_plan(room, found.plan)
        assert (found.plan.status is Status.NO_PATH) == math.isinf(exact)
        if math.isfinite(exact):
            asked += 1
            short += found.plan.length <= 1.25 * exact
    assert short >= 0.95 * asked


def test_the_same_seed_gives_the_same_bytes_with_any_number_of_threads():
    """Plan, history and pheromone do not depend on the threads, and do depend on the seed."""
    rng = np.random.default_rng(8)
    problem = Problem(scattered(rng, 30, 0.25), (0, 0), (29, 29), Moves.EIGHT_CUT)
    for rule in RULES:
        runs = [
            explore(problem, seed=seed, rule=rule, heuristic="goal", cycles=6, ants=23, threads=threads)
            for seed, threads in ((1, 1), (1, 1), (1, 2), (1, 4), (2, 1))
        ]
        for other in runs[1:4]:
            assert same(runs[0].plan, other.plan)
            assert runs[0].history.tobytes() == other.history.tobytes()
            assert runs[0].pheromone.tobytes() == other.pheromone.tobytes()
        assert runs[0].history.tobytes() != runs[4].history.tobytes()


def test_a_budget_stops_the_ants_and_keeps_the_best_so_far():
    """Expired, cancelled, without cycles: BUDGET; out of time later: BUDGET with a legal path; more cycles never do worse."""
    problem = Problem(Grid(np.zeros((20, 20), dtype=bool)), (0, 0), (19, 7))
    cancelled = threading.Event()
    cancelled.set()
    for budget in (Budget(seconds=0.0), Budget(cancel=cancelled), Budget(cycles=0)):
        plan = ants(problem, budget=budget)
        check_plan(problem, plan)
        assert plan.status is Status.BUDGET and len(plan.cells) == 0
    lengths = [ants(problem, seed=3, heuristic="goal", beta=1.0, cycles=c).length for c in range(1, 12)]
    assert lengths == sorted(lengths, reverse=True)
    problem = Problem(Grid(np.zeros((60, 60), dtype=bool)), (0, 0), (59, 30))
    late = explore(problem, budget=Budget(seconds=0.05), heuristic="goal", beta=0.0, cycles=10**6)
    check_plan(problem, late.plan)
    assert late.plan.status is Status.BUDGET and len(late.plan.cells) > 0 and len(late.history) < 10**6


def test_the_ends_may_be_one_cell_or_walled_apart():
    """Start at the goal: a path of one cell, optimal; a walled goal: NO_PATH with the proof from the field."""
    grid = np.zeros((5, 5), dtype=bool)
    grid[:, 2] = True
    problem = Problem(Grid(grid), (0, 0), (0, 0))
    plan = ants(problem)
    check_plan(problem, plan)
    assert plan.length == 0 and plan.optimal and plan.cells.tolist() == [[0, 0]]
    problem = Problem(Grid(grid), (0, 0), (0, 4))
    plan = ants(problem)
    check_plan(problem, plan)
    assert plan.status is Status.NO_PATH


def test_the_step_limit_is_kept():
    """No ant walks farther than the limit; where it is below the shortest path there is no path, which is BUDGET."""
    problem = Problem(Grid(np.zeros((1, 9), dtype=bool)), (0, 0), (0, 8))
    assert ants(problem, step_limit=7).status is Status.BUDGET
    assert ants(problem, step_limit=8).length == 8
    assert ants(problem).expanded == ants(problem, cycles=1).expanded, "the first path is proved to be a shortest one"
    assert ants(problem, step_limit=7, cycles=3, ants=4).expanded == 7 * 3 * 4


def test_a_window_and_forbidden_cells_bound_the_search():
    """Paths keep in the window and off forbidden cells, pheromone has the window's shape, and NO_PATH is about both."""
    problem = Problem(Grid(np.zeros((30, 40), dtype=bool), resolution=0.5), (12, 12), (12, 18))
    forbidden = np.zeros((30, 40), dtype=bool)
    forbidden[10:20, 15] = True
    forbidden[12, 12] = True  # the start: the robot may stand where an obstacle may come
    found = explore(problem, window=(8, 10, 12, 12), forbidden=forbidden, cycles=3)
    check_plan(problem, found.plan)
    rows, cols = found.plan.cells.T
    assert rows.min() >= 8 and cols.max() < 22 and not forbidden[rows[1:], cols[1:]].any()
    assert (
        found.pheromone.shape == (12, 12, 8) and found.pheromone_by_cell.shape == (12, 12) and found.window == (8, 10, 12, 12)
    )
    assert found.pheromone_by_cell[2, 5] == 0 and found.pheromone_by_cell[0, 5] > 0
    assert found.plan.length == pytest.approx(0.5 * (4 + 4 * math.sqrt(2)))
    forbidden[8:20, 15] = True
    assert explore(problem, window=(8, 10, 12, 12), forbidden=forbidden).plan.status is Status.NO_PATH
    assert explore(problem, forbidden=forbidden).plan.status is Status.FOUND
    forbidden[12, 18] = True
    assert explore(problem, forbidden=forbidden).plan.status is Status.NO_PATH
    there = Problem(problem.grid, (12, 18), (12, 18))
    assert explore(there, forbidden=forbidden).plan.status is Status.FOUND  # at the goal, though it is forbidden
    for window in ((-1, 0, 30, 40), (0, -1, 30, 40), (1, 0, 30, 40), (0, 1, 30, 40), (0, 0, 12, 40), (0, 0, 30, 18)):
        with pytest.raises(BadParameter, match="window"):
            explore(problem, window=window)


def test_history_and_pheromone_tell_how_the_colony_converged():
    """Best never rises, shares lie in [0, 1], entropy falls, and pheromone gathers on the best path."""
    rng = np.random.default_rng(5)
    problem = Problem(scattered(rng, 15, 0.2), (0, 0), (14, 14))
    found = explore(problem, persistence=Constant(0.7), heuristic="distance", cycles=60)
    best, mean, share, entropy = found.history.T
    assert (np.diff(best) <= 0).all() and best[-1] == found.plan.length
    assert (mean >= best - 1e-9).all() and ((share > 0.9) & (share <= 1.0)).all()
    assert entropy[-1] < 0.7 * entropy[0] and entropy[0] <= math.log(found.pheromone.size)
    path = found.pheromone_by_cell[tuple(found.plan.cells[:-1].T)]
    assert np.median(path) > 3 * np.median(found.pheromone_by_cell[~problem.grid.blocked])


def test_pheromone_left_by_one_colony_starts_the_next():
    """A warm colony begins where the other ended: its first cycle is better than the first of a cold one."""
    problem = Problem(Grid(np.zeros((20, 20), dtype=bool)), (0, 0), (19, 12))
    options = {"heuristic": "goal", "beta": 2.0, "rule": "as", "persistence": Constant(0.7)}
    cold = explore(problem, seed=1, cycles=30, **options)
    warm = explore(problem, seed=2, cycles=1, pheromone=cold.pheromone, **options)
    assert warm.history[0, 1] < 0.9 * explore(problem, seed=2, cycles=1, **options).history[0, 1]
    corridor = explore(problem, seed=2, cycles=1, pheromone="corridor", **options)
    assert corridor.history[0, 1] < explore(problem, seed=2, cycles=1, **options).history[0, 1]


def test_given_pheromone_is_kept_within_the_limits():
    """Of a rule with limits; it is refused where ants have nothing to search, too, if it is none."""
    problem = Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2))
    usual = explore(problem, rule="mmas", cycles=0).pheromone
    given = np.full(usual.shape, 1e-9)
    given[1] = 1e9
    started = explore(problem, rule="mmas", cycles=0, pheromone=given).pheromone
    assert (started[1] == usual[1]).all() and started[1].max() == usual.max()
    low = started[[0, 2]][usual[[0, 2]] > 0.0]
    assert 0.0 < low.min() == low.max() < usual.max()


@pytest.mark.parametrize("ends", [((0, 0), (0, 0)), ((0, 0), (2, 2))])
@pytest.mark.parametrize("wrong", ["thick", np.ones((3, 2, 8)), np.full((3, 3, 8), math.nan), None])
def test_wrong_pheromone_is_refused_where_there_is_nothing_to_search(ends, wrong):
    """At the goal, or where no path leads there, it used to be taken for pheromone."""
    blocked = np.eye(3, dtype=bool)[::-1]
    with pytest.raises(BadInput, match="pheromone"):
        explore(Problem(Grid(blocked), *ends), pheromone=wrong)


def test_greedy_ants_of_acs_take_the_best_move():
    """With q0 = 1 all ants of a cycle go the same way; the smaller it is, the more their paths differ."""
    problem = Problem(Grid(np.zeros((20, 20), dtype=bool)), (0, 0), (19, 7))
    over = []
    for q0 in (1.0, 0.9, 0.0):
        best, mean = explore(problem, rule=AntColonySystem(q0=q0), heuristic="goal", cycles=1).history[0, :2]
        over.append(mean / best)
    assert over[0] == pytest.approx(1.0) and over[0] < over[1] < over[2]


def test_the_immune_operator_keeps_paths_legal_and_runs_repeatable():
    """Vaccinated colonies give legal plans, the same for any number of threads, and other ones than plain colonies."""
    rng = np.random.default_rng(9)
    differ = 0
    for i in range(cases(20, 500)):
        problem = random_problem(rng)
        options = {"seed": i, "rule": list(RULES)[i % 5], "heuristic": "goal", "cycles": 12, "ants": 10, "step_limit": 60}
        strong = Immune(archive=4, share=0.5, vaccinated=1.0, stagnation=3)
        found = explore(problem, immune=strong, **options)
        check_plan(problem, found.plan)
        twin = explore(problem, immune=strong, threads=2, **options)
        assert same(found.plan, twin.plan) and found.pheromone.tobytes() == twin.pheromone.tobytes()
        assert np.isfinite(found.pheromone).all()
        differ += explore(problem, **options).pheromone.tobytes() != found.pheromone.tobytes()
    assert differ > 5


def test_adaptive_persistence_keeps_more_ants_alive_than_the_printed_one():
    """III.D as printed makes all edges alike; corrected it does not (the paper's improvement, measured)."""
    rng = np.random.default_rng(6)
    problem = Problem(
        Grid((rng.random((20, 20)) < 0.3) & (np.indices((20, 20)).sum(0) % 38 != 0)), (0, 0), (19, 19), Moves.EIGHT_CUT
    )
    options = {"rule": "as", "heuristic": "goal", "retreat": False, "cycles": 30, "ants": 30}
    corrected = explore(problem, persistence=Adaptive(), **options)
    printed = explore(problem, persistence=Printed(), **options)
    assert corrected.history[-1, 2] > 2 * printed.history[-1, 2]
    assert corrected.plan.length < printed.plan.length


BAD = {
    "rule": ["", "tabu", 3, None],
    "persistence": [0.5, "constant"],
    "ants": [0, -1, 2.5, True, "5"],
    "cycles": [-1, 1.0, None, 2**40],
    "alpha": [-1.0, math.nan, math.inf, "1"],
    "beta": [-1.0, math.nan, True],
    "heuristic": ["manhattan", None, 1],
    "step_limit": [-1, 2.0, 2**40],
    "pheromone": [
        "thick",
        np.zeros((3, 3, 8)),
        np.ones((3, 3, 8)) - np.eye(3)[..., None],
        np.ones((3, 3)),
        np.full((3, 3, 8), np.nan),
        None,
        7,
    ],
    "window": [(0, 0, 9, 9), (1, 1, 2, 2), (0, 0, 0, 0), (0, 0, 3), "all", (-1, 0, 4, 3), (0.5, 0, 3, 3)],
    "forbidden": [np.zeros((2, 2), dtype=bool), "none", [[False], [False, True]]],
    "immune": [True, 0.5],
    "threads": [0, -1, 1.5, 10**6],
    "seed": [-1, 2**64, 1.0, "0", None],
}


@pytest.mark.parametrize("name", BAD)
def test_wrong_options_are_refused_by_name(name):
    """Each wrong option raises a BadInput."""
    problem = Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2))
    for value in BAD[name]:
        with pytest.raises(BadInput):
            ants(problem, **{name: value})


def test_what_ants_cannot_do_is_refused():
    """Longer moves, maps beyond the limit, and things that are no problem."""
    grid = Grid(np.zeros((3, 3), dtype=bool))
    with pytest.raises(BadParameter, match="moves"):
        ants(Problem(grid, (0, 0), (2, 2), Moves.SIXTEEN))
    with pytest.raises(BadParameter, match="problem"):
        ants(grid)
    with pytest.raises(BadParameter, match=r"speed = 1: must be left out: the options are rule, "):
        ants(Problem(grid, (0, 0), (2, 2)), speed=1)
    big = Problem(Grid(np.zeros((2049, 2048), dtype=bool)), (0, 0), (5, 5))
    with pytest.raises(TooLarge, match="cells"):
        ants(big)
    assert ants(big, window=(0, 0, 10, 10)).optimal
    with pytest.raises(TooLarge, match="step_limit"):
        walkers.Ants(walkers.AntGraph(Problem(grid, (0, 0), (2, 2))), 2**30, 2**24)


def test_a_rule_object_is_taken_as_it_is():
    """Its parameters stand unless an option changes them."""
    problem = Problem(Grid(np.zeros((6, 6), dtype=bool)), (0, 0), (5, 5))
    rule = MaxMinAntSystem(ants=7, beta=3.0, persistence=Constant(0.8))
    a = explore(problem, rule=rule, cycles=2, step_limit=1)
    b = explore(problem, rule="mmas", ants=7, beta=3.0, persistence=Constant(0.8), cycles=2, step_limit=1)
    assert a.plan.expanded == 14 and a.pheromone.tobytes() == b.pheromone.tobytes()
    a = explore(problem, rule=rule, cycles=2, heuristic="goal")
    b = explore(problem, rule="mmas", ants=7, beta=3.0, persistence=Constant(0.8), cycles=2, heuristic="goal")
    assert a.history.tobytes() == b.history.tobytes() and a.history[1, 2] > 0.0


class _Looks(threading.Event):
    """An event that counts the looks at it, and is set from the n-th on."""

    def __init__(self, n: int) -> None:
        super().__init__()
        self.count, self.n = 0, n

    def is_set(self) -> bool:
        self.count += 1
        return self.count > self.n


def test_the_clock_is_looked_at_in_every_pass_over_the_map(monkeypatch):
    """C10: cancelled at whichever look, the search ends after few more, with a legal plan; passes over the map look often."""
    assert walkers.PART <= 2**15, "looks on a large map, about 5 ms apart"
    monkeypatch.setattr(walkers, "PART", 2**12)
    blocked = np.random.default_rng(3).random((140, 140)) < 0.2
    blocked[0, 0] = blocked[139, 139] = False
    problem = Problem(Grid(blocked), (0, 0), (139, 139))
    whole = _Looks(10**9)
    done = ants(problem, budget=Budget(cancel=whole), cycles=1, ants=4)
    check_plan(problem, done)
    passes = 4 * math.ceil(142 * 142 / walkers.PART)  # what is seen, counted, laid and weighed
    assert whole.count >= passes
    for n in range(whole.count):
        looks = _Looks(n)
        plan = ants(problem, budget=Budget(cancel=looks), cycles=1, ants=4)
        check_plan(problem, plan)
        assert plan.status is not Status.NO_PATH and looks.count <= n + 8


def test_mmas_learns_within_its_default_cycles() -> None:
    """On random 30 x 30 maps MMAS by name comes in 50 cycles within 8 % of the optimum on average, as the Ant System does."""
    over: dict[str, list[float]] = {"as": [], "mmas": []}
    rng = np.random.default_rng(11)
    for seed in range(cases(4, 40)):
        blocked = rng.random((30, 30)) < 0.2
        blocked[:2, :2] = blocked[-2:, -2:] = False
        problem = Problem(Grid(blocked), (0, 0), (29, 29))
        for rule, lengths in over.items():
            plan = explore(problem, rule=rule, heuristic="goal", seed=seed).plan
            if plan.status is Status.FOUND:
                lengths.append(plan.length / plan.lower_bound - 1.0)
    assert len(over["mmas"]) == len(over["as"]) >= 3
    assert np.mean(over["as"]) < 0.08 and np.mean(over["mmas"]) < 0.08
