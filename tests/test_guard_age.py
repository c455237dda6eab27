"""The guard where scans are older than odometry, as in the ROS 2 node: the declared bound on swerving counts, and is kept."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import ndimage

from antway import Command, Grid, Observation, RobotSpec, Task, Tracks
from antway.kernels.base.records import Trajectories
from antway.kernels.robot.contact import GOES_ON, HIT_STANDING, Record
from antway.kernels.robot.cycle import play
from antway.kernels.robot.reach import split_at_walls
from antway.kernels.robot.sweep import Body
from antway.policies import guard as guarding
from antway.policies.guard import Guard
from antway.world.terrain import walls_of
from common import costly
from test_guard_dynamics import BOUND, COUNT, DT, GOAL, MAPS, POLICIES, SIZE, STARTS, Chasers, some_robot, wish

PARTS, CYCLES = 20, 60  # steps of 5 ms in a cycle, in each of which a disc has one velocity; cycles of an episode
STEP = DT / PARTS


class Swervers(Chasers):
    """Discs that swerve towards the robot as hard as declared all the time, and at a wall turn to it at once."""

    def move(self, xy: np.ndarray, velocity: np.ndarray, walls: np.ndarray) -> np.ndarray:
        """Move for a step, in which the robot drives on from `xy` among walls with these centres; return the places."""
        lead = self.rng.uniform(0.0, 1.5, (COUNT, 1))
        away = xy + velocity * lead - self.xy - self.velocity * lead
        new = self.velocity + away / np.maximum(np.hypot(*away.T), 1e-9)[:, None] * self.swerve * STEP
        new *= (BOUND / np.maximum(np.hypot(*new.T), BOUND))[:, None]
        before, self.xy, self.velocity = touches(self.xy, self.radius, walls), self.xy + (self.velocity + new) / 2 * STEP, new
        meets, to = touches(self.xy, self.radius, walls) & ~before, xy - self.xy
        self.velocity[meets] = (to / np.maximum(np.hypot(*to.T), 1e-9)[:, None] * BOUND)[meets]
        return self.xy


def touches(xy: np.ndarray, radius: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """Which discs touch one of the cells with these centres."""
    apart = np.maximum(np.abs(xy[:, None] - walls) - SIZE / 2, 0.0)
    return np.hypot(apart[..., 0], apart[..., 1]).min(axis=1) < radius


def episode(seed: int, drive: str, swerve: float) -> tuple[int, int]:
    """Play a robot with scans that are 5 to 80 ms old; return in how many cycles it moved, and a command passed as it was."""
    rng = np.random.default_rng([seed, len(drive)])
    spec, which = some_robot(rng, drive, polygon=False), int(rng.integers(2))
    grid, xy = MAPS[which], np.array(STARTS[which][rng.integers(4)])
    task = Task(grid, spec, tuple(xy), GOAL, obstacle_speed=BOUND, obstacle_swerve=swerve)
    guard, discs = Guard(), Swervers(rng, math.inf, swerve, xy, spec.radius + 0.5)
    walls = grid.to_xy(np.argwhere(grid.blocked & ~ndimage.binary_erosion(grid.blocked)))
    guard.reset(task)
    body = Body(spec.corners, spec.rounding, spec.radius, np.zeros((1, 2)))
    pairs = np.zeros((CYCLES + 1, 2))
    record = Record(pairs[:, 0].copy(), pairs.copy(), pairs.copy(), pairs[:, 0].copy(), pairs[:, 0].copy(), pairs[1:].copy())
    record.xy[0], record.heading[0] = xy, rng.uniform(-math.pi, math.pi)
    first, late, moving, free = np.arange(COUNT + 1) * (PARTS + 1), math.ceil(spec.latency / DT - 1e-9), 0, 0
    knots, speeds = np.tile(discs.xy, (PARTS + 1, 1, 1)), np.zeros((PARTS, COUNT, 2))  # of the cycle before
    for i in range(CYCLES):
        t, xy, velocity, theta = i * DT, record.xy[i], record.velocity[i], float(record.heading[i])
        old = int(rng.integers(1, 17))
        seen = Tracks(np.arange(COUNT), knots[PARTS - old].copy(), speeds[PARTS - old].copy(), discs.radius + 1e-5)
        pending = np.zeros((late, 2))
        if late:
            pending[late - min(late, i) :] = record.command[max(i - late, 0) : i]
        o = Observation(t, tuple(xy), tuple(velocity), theta, seen, t - old * STEP, float(record.turn_rate[i]), pending)
        nearest = discs.xy[int(np.argmin(np.hypot(*(discs.xy - xy).T)))] - xy
        record.command[i] = guard.limit(o, wish(rng, POLICIES[i // 20], spec, nearest, theta, i)).acts(o, spec)
        knots[0] = discs.xy
        for k in range(PARTS):
            speeds[k] = discs.velocity
            knots[k + 1] = discs.move(xy + velocity * k * STEP, velocity, walls)
        times, places = np.tile(t + np.arange(PARTS + 1) * STEP, COUNT), knots.transpose(1, 0, 2).reshape(-1, 2)
        line = Trajectories(times, places.copy(), first, discs.radius.copy())
        for part in line:
            part.setflags(write=False)  # as those of a world are; else the kernel would be compiled once more
        what, _, _ = play(i, DT, spec.limits, body, record, np.array([100.0, 100.0, 0.1]), walls_of(grid), line, math.inf)
        if what == HIT_STANDING:
            break
        assert what == GOES_ON, (what, seed, drive, i, guard.did, spec)
        moving += math.hypot(*record.velocity[i + 1]) > 1e-9
        free += guard.did == "free"
    return moving, free


@pytest.mark.parametrize("swerve", [0.3, 2.2])
@pytest.mark.parametrize("drive", ["holonomic", "differential", "ackermann"])
def test_the_promise_holds_where_scans_are_old_and_obstacles_swerve_as_hard_as_declared(drive: str, swerve: float) -> None:
    """C24, C45: 0 contacts in motion and 0 with walls, although what has been seen may have swerved since, or met a wall."""
    moving, free = np.sum([episode(seed, drive, swerve) for seed in range(costly(60, 4000))], axis=0)
    assert moving > 50 and free > 50


ROBOTS = (RobotSpec(a_max=1.0, dynamics="steps"), RobotSpec(a_max=1.0), RobotSpec(a_max=1.0, drive="differential"))


def limited(robot: RobotSpec, xy: tuple[float, float], velocity: tuple[float, float], age: float, swerve: float) -> str:
    """What the guard does about a robot that drives on at 1 m/s, with one obstacle, seen so long ago."""
    guard = Guard()
    guard.reset(Task(Grid(np.zeros((60, 80), dtype=bool), 0.1), robot, (2.0, 3.0), (7.0, 3.0), obstacle_swerve=swerve))
    then = np.array([xy]) - age * np.array([velocity])
    one = Tracks(np.array([1]), then, np.array([velocity]), np.array([0.3]))
    guard.limit(Observation(5.0, (2.0, 3.0), (1.0, 0.0), 0.0, one, 5.0 - age), Command((1.0, 0.0)))
    return guard.did


@pytest.mark.parametrize("robot", ROBOTS)
def test_whoever_was_seen_some_milliseconds_ago_is_bound_as_declared(robot: RobotSpec) -> None:
    """He comes by 0.9 m beside the robot: it drives on. It used to slow down unless the scan was of this very moment."""
    for age in (0.0, 0.005, 0.03, 0.08, 0.15):
        assert limited(robot, (3.5, 3.9), (-1.0, 0.0), age, 0.3) == "free"
        assert limited(robot, (3.5, 3.9), (-1.0, 0.0), age, math.inf) != "free"
        assert limited(robot, (3.5, 3.9), (-1.0, 0.0), age, 5.0) != "free"
    assert limited(robot, (3.5, 3.9), (-1.0, 0.0), 0.45, 1.0) != "free"  # he can have swerved since


@pytest.mark.parametrize("robot", ROBOTS)
def test_walls_that_an_obstacle_may_have_met_since_the_scan_count(robot: RobotSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    """Time runs from the scan on: who meets a wall just before the robot stands gets a row for what he may do then."""
    rows = list[int]()
    monkeypatch.setattr(guarding, "split_at_walls", lambda *about: rows.append(split_at_walls(*about)) or rows[-1])
    meets = np.arange(0.9, 1.8, 0.01)  # s; when he meets the wall
    for age in (0.0, 0.1, 0.2):
        for t in meets:
            limited(robot, (7.7 - t, 1.0), (1.0, 0.0), age, 0.0)
    first, *later = np.array(rows).reshape(3, -1)
    assert 0 < (first == 2).sum() < len(meets)
    for found in later:
        assert (found == 2).sum() >= (first == 2).sum()
