"""Compiles kernels before they are needed: small tasks of each kind run on all cores, and their kernels stay on disk."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from antway import checks
from antway.kernels.base.cache import is_compiled
from antway.processes import pool, uninterrupted
from antway.tables import NEED_PYRVO, PLANNERS, POLICIES, WARM

if TYPE_CHECKING:
    from antway.ants.tsp import Tsp
    from antway.grid import Moves
    from antway.planning import Problem


def warm_up(kinds: Sequence[str] = WARM, *, workers: int = 2) -> Iterator[tuple[str, float]]:
    """Compile the kernels for these kinds of task; yield each task and its seconds when it is done.

    Kinds are "plan" (every planner, smoothing), "run" (policies antway and paper on the shipped scenes), "robots" (with inertia
    and wheels, a car), "tours" (of cities, on maps, with time windows), and "baselines" (every other policy). A script that
    calls this must guard its own code by `if __name__ == "__main__"`, because the workers are processes.

    Raises
    ------
    BadParameter
        For an unknown kind.

    Examples
    --------
    >>> list(warm_up([]))
    []
    """
    names = [checks.choice("kind", kind, WARM) for kind in kinds]
    tasks = [task for kind in WARM if kind in names for task in _TASKS[kind]]
    if not tasks:
        return
    # What policy antway needs everywhere is compiled by one process beside the other tasks, before tasks that need it as well.
    tasks.sort(key=lambda task: (task[1] == "antway") - 2 * (task == ("run", "antway")))
    with pool(min(checks.integer("workers", workers, low=1), len(tasks))) as processes:
        running = [processes.submit(_timed, name, argument) for name, argument in tasks]
        for done in as_completed(running):
            yield done.result()


@contextmanager
def compiling_beside(policy: str) -> Iterator[None]:
    """Compile kernels for the first episode of policy antway, which is played in this context, in a second process.

    The process starts with the kernels that the episode needs last. Each kernel is compiled by the process that needs it first
    and read from disk by the other. Nothing is started for other policies, on one core, or if the kernels exist already.
    """
    if policy != "antway" or is_compiled("", "crossing.cycle") or (os.cpu_count() or 1) < 2:
        yield
        return
    quiet = os.environ | {"ANTWAY_QUIET": "1"}
    with uninterrupted():
        beside = subprocess.Popen([sys.executable, "-c", "from antway.warmup import late; late()"], env=quiet)
    try:
        yield
    finally:
        beside.terminate()
        beside.wait()


def late() -> None:
    """Compile the kernels of an episode of policy antway: guard, search, alternatives, shortest path.

    Guard and search are ready before the episode needs them. Meanwhile the episode compiles the moves on the map, the sensor
    and the prediction.
    """
    from antway import Command, Problem, RobotSpec, Task, load_map, load_scenario, solve
    from antway.kernels.search.polyanya import build_mesh
    from antway.policies.antway.alternatives import Snapshot, manner
    from antway.policies.antway.policy import AntwayPolicy
    from antway.policies.guard import Guard
    from antway.policies.paper.routes import StaticRoutes
    from antway.world.episode import Episode

    task, policy, guard = Task(load_map("office"), RobotSpec(), (1.5, 3.0), (22.0, 12.5)), AntwayPolicy(), Guard()
    guard.reset(task)
    build_mesh(task.grid.blocked)  # meanwhile the episode compiles the moves on the map
    policy.reset(task, 0)
    s = policy._state
    estimates, prediction = s.crowd.tracks.averaged[:1].copy(), s.crowd.prediction[:1].copy()
    estimates[0, :2], prediction[:] = (task.start[0] + 2.0, task.start[1]), 0.0  # an obstacle that is predicted to stand
    none = s.plan.segments[:0].copy()
    snapshot = Snapshot(s.context, s.settings, s.terrain, 0.0, 0.0, task.start, estimates, prediction, none)
    path, segments = snapshot.straight(), snapshot.segments_of(0)
    if path is not None and len(segments):
        snapshot.conflict(path, segments)
        snapshot.cost(path)
        manner("crossing", (1.0, 0.0), path, segments, 0.0)
    # The rest follows in the reverse order of the episode, so that each process compiles what the other has not reached.
    solve(Problem(task.grid.inflate(0.25), (20, 20), (100, 200)), "anyangle")
    StaticRoutes(task)
    stage = Episode(load_scenario("office"), policy, seed=0).stage
    seen = stage.observe()
    s.tracker.estimates = estimates
    policy._aside(seen, 0.0, (0.0, 0.0))
    stage.drive(0.0, 0.0)
    policy.pheromone()
    guard.limit(seen, Command((0.0, 0.0)))


def twelve_cities() -> Tsp:
    """Return a small travelling salesman problem, which is solved only so that its kernels are compiled."""
    import numpy as np

    from antway.ants.tsp import Tsp

    return Tsp(np.array([(k % 4, k * k % 7) for k in range(12)], float))


def small_problem(moves: Moves) -> Problem:
    """Return a small problem of planning, which is solved only so that its kernels are compiled."""
    import numpy as np

    from antway import Grid, Problem

    blocked = np.zeros((9, 9), dtype=bool)
    blocked[2:, 4] = True
    return Problem(Grid(blocked), (7, 1), (7, 7), moves)


def _timed(name: str, argument: str) -> tuple[str, float]:
    started = time.perf_counter()
    _DO[name](argument)
    return f"{name} {argument}".strip(), time.perf_counter() - started


def _plan(planner: str) -> None:
    from antway import load_map, plan

    plan(load_map("office"), (1.5, 3.0), (22.0, 12.5), robot_radius=0.25, planner=planner)


def _smooth(robot: str) -> None:
    from antway import load_map, plan, smooth
    from antway.world.robots import load_robot

    smooth(plan(load_map("office"), (1.5, 3.0), (22.0, 12.5), robot_radius=0.4), load_robot(robot), trials=1)


def _run(policy: str, scene: str = "office", robot: str = "", seconds: float | None = None) -> None:
    from antway import load_scenario, run
    from antway.world.robots import load_robot

    scenario = load_scenario(scene)
    run(scenario.driven_by(load_robot(robot)) if robot else scenario, policy, horizon=seconds)


def _car(policy: str) -> None:
    """Drive a car whose commands act late and whose sensor has noise."""
    from antway import load_scenario, run
    from antway.world.robots import load_robot

    robot = replace(load_robot("turtlebot4"), drive="ackermann", turning_radius=0.5, latency=0.1)
    scenario = load_scenario("office").driven_by(robot)
    run(replace(scenario, sensor=replace(scenario.sensor, noise=0.01)), policy, horizon=10.0)


def _tour(kind: str) -> None:
    import numpy as np

    from antway import load_map, plan_tour, solve_tsp, solve_tsptw
    from antway.tours.time_windows import Tsptw

    if kind == "of cities":
        for rule in ("as", "mmas", "acs"):
            solve_tsp(twelve_cities(), rule=rule, cycles=1)
        solve_tsp(twelve_cities(), local_search="3opt", cycles=1)
    elif kind == "with time windows":
        xy = np.asarray(twelve_cities().xy)
        times = np.hypot(*(xy[:, None] - xy[None]).T)
        for latest in (1000.0, 1.0):  # s; a tour in time, and one that is late
            solve_tsptw(Tsptw(times, np.array([(0.0, latest)] * 12)), cycles=1)
    else:
        plan_tour(load_map("office"), (1.5, 3.0), [(22.0, 12.5), (1.5, 12.5), (12.0, 2.0)], robot_radius=0.25, seconds=0.1)


_DO: dict[str, Callable[[str], None]] = {
    "plan by": _plan,
    "plan for": _smooth,
    "run": _run,
    "rounds by": partial(_run, scene="rounds"),
    "wheels, policy": partial(_run, robot="turtlebot4", seconds=10.0),
    "car, policy": _car,
    "inertia, policy": partial(_run, robot="inertia", seconds=10.0),
    "paper's scene by": partial(_run, scene="paper", seconds=10.0),
    "tour": _tour,
}
_TASKS = {
    "plan": [*(("plan by", planner) for planner in PLANNERS), ("plan for", "jackal")],
    "run": [("run", "antway"), ("paper's scene by", "paper"), ("rounds by", "antway")],
    "robots": [("wheels, policy", "antway"), ("car, policy", "antway"), ("inertia, policy", "antway")],
    "tours": [("tour", "of cities"), ("tour", "on a map"), ("tour", "with time windows")],
    "baselines": [("paper's scene by", policy) for policy in POLICIES if policy not in ("antway", "paper", *NEED_PYRVO)],
}
