"""Drives in which the planner's process is killed or stopped at any moment: what the robot does then, and how soon."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from antway import Grid, RobotSpec, Scenario, World
from antway.policies.guard_process import GuardProcess
from antway.world.motions import Bounce
from antway.world.robots import load_robot
from antway.world.stage import Stage
from antway.world.trace import Outcome
from antway.world.world import Obstacle

PERIOD = 0.2  # s
ROBOTS = {"holonomic": RobotSpec(dt=PERIOD), "inertia": RobotSpec(a_max=1.0, dt=PERIOD), "diff": load_robot("diff")}


@dataclass(frozen=True)
class Drive:
    """What came of one: outcome, seconds from observation to answer before and after the planner's end, what the guard did."""

    how: str
    outcome: Outcome | None
    before: list[float]
    after: list[float]
    did: list[str]
    speed: float


def place(seed: int, robot: RobotSpec) -> Scenario:
    """A hall of 12 x 12 m with pillars, and discs that bounce about in it."""
    rng = np.random.default_rng(seed)
    blocked = np.zeros((48, 48), bool)
    for row, col in rng.integers(8, 40, (4, 2)):
        blocked[row : row + 3, col : col + 3] = True
    blocked[:8, :8] = blocked[-8:, -8:] = False
    grid = Grid(blocked, 0.25)
    room, discs = grid.inflate(0.6), []
    while len(discs) < 6:
        x, y = rng.uniform(2.5, 9.5, 2).tolist()
        if room.is_free(room.cell_at((x, y))):
            discs.append(Obstacle(0.3, Bounce((x, y), float(rng.uniform(0.3, 0.8)), float(rng.uniform(-3, 3)))))
    return Scenario(World(grid, tuple(discs)), (1.0, 1.0), (11.0, 11.0), robot, obstacle_speed=0.8, horizon=60.0)


def drives(count: int, seed: int) -> Iterator[Drive]:
    """Play so many drives; in each the planner is killed or stopped a random time after a random observation."""
    command = [sys.executable, str(Path(__file__).with_name("planners.py"))]
    rng = np.random.default_rng(seed)
    robots = {name: robot if robot.dt == PERIOD else RobotSpec(**_fields(robot)) for name, robot in ROBOTS.items()}
    scenarios = [place(seed + k, list(robots.values())[k % len(robots)]) for k in range(count)]
    with (
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as planners,
        GuardProcess(scenarios[0].task, mode="strict") as guard,
    ):
        assert planners.stdin is not None and planners.stdout is not None
        for k, scenario in enumerate(scenarios):
            guard.reset(scenario.task)
            pickle.dump((guard.folder, scenario, {"mode": "strict"}, k), planners.stdin)
            planners.stdin.flush()
            pid = int(planners.stdout.readline())
            how = ("killed", "stopped")[int(rng.integers(2))]
            try:
                yield _drive(guard, Stage(scenario, k, scenario.horizon), pid, how, int(rng.integers(2, 25)), rng)
            finally:
                os.kill(pid, signal.SIGKILL) if how == "stopped" else None
        planners.stdin.close()


def _fields(robot: RobotSpec) -> dict[str, object]:
    return {name: getattr(robot, name) for name in robot.__slots__ if name != "dt"} | {"dt": PERIOD}


def _drive(guard: GuardProcess, stage: Stage, pid: int, how: str, last: int, rng: np.random.Generator) -> Drive:
    outcome, before, after, did, gone = None, [], [], [], False
    while outcome is None and (len(after) < 3 or not stage.at_rest) and len(after) < 60:
        seen = stage.observe()
        started = time.monotonic()
        number = guard.observe(seen)
        if stage.n == last:
            time.sleep(float(rng.uniform(0.0, 0.004)))
            os.kill(pid, signal.SIGKILL if how == "killed" else signal.SIGSTOP)
            gone = True
        answer = guard.answer(number)
        took = time.monotonic() - started
        if gone and stage.n > last:
            after.append(took)
            did.append(answer.did)
        else:
            before.append(took)
        outcome, _ = stage.drive(*stage.controls(answer.command, seen))
    return Drive(how, outcome, before, after, did, float(np.hypot(*stage.velocity[stage.n])))
