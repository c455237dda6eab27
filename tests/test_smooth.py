"""Smoothed plans: kernels equal their twins, motions are drivable and clear, never later than with stops at corners (C29)."""

from __future__ import annotations

import json
import math
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from typer.testing import CliRunner

from antway import (
    BadParameter,
    Grid,
    InvalidPlan,
    Plan,
    Problem,
    RobotSpec,
    Status,
    TooLarge,
    check_motion,
    check_plan,
    load_map,
    plan,
    smooth,
    solve,
)
from antway.cli import app
from antway.kernels.trajectory import smooth as kernels
from antway.trajectory.motion import Motion
from antway.trajectory.profile import stop_at_corners, straight_legs, without_repeats
from antway.trajectory.smooth import covering_discs
from antway.world.line_of_sight import passes
from antway.world.robots import load_robot
from antway.world.rollouts import finite_limits
from common import cases, random_grid
from naive import smooth as naive

DIFF = load_robot("diff")
CAR = RobotSpec(
    v_max=1.5, a_max=1.0, brake_max=1.5, drive="ackermann", turn_rate=1.9, alpha_max=3.0, turning_radius=0.6,
    footprint=((-0.35, -0.2), (0.35, -0.2), (0.35, 0.2), (-0.35, 0.2)),
)  # fmt: skip
ROBOTS = {
    "holonomic": RobotSpec(),
    "inertia": RobotSpec(a_max=1.0, brake_max=2.0),
    "box": RobotSpec(a_max=1.0, footprint=((-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2))),
    "diff": DIFF,
    "jackal": load_robot("jackal"),
    "car": CAR,
}
OFFICE = load_map("office")


def curve(points: np.ndarray, samples: int) -> kernels.Curve:
    """Memory for a curve."""
    count = (len(points) + 1) * samples + 1
    return kernels.Curve(points.copy(), np.zeros((count, 2)), np.zeros((count, 2)), *(np.zeros(count) for _ in range(6)))


def around(grid: Grid, need: float, points: np.ndarray, discs: tuple = ((0.0, 0.0),)) -> kernels.Surroundings:
    """All blocked cells of a map as its border, an array of the kind for which the kernels are compiled anyway."""
    ends = np.array([(*points[0], need), (*points[-1], need)])
    return kernels.Surroundings(grid.blocked.copy(), grid.clearance(), grid.resolution, need, ends, np.array(discs), False)


def wandering(rng: np.random.Generator, count: int) -> np.ndarray:
    """Control points that go from left to right."""
    return np.column_stack((np.linspace(0.7, 4.3, count), 2.5 + rng.normal(0.0, 0.3, count).cumsum()))


def test_missing_clearance_is_the_distance_from_every_cell() -> None:
    """Against all blocked squares: what is missing, and 0 where nothing is."""
    rng = np.random.default_rng(0)
    for _ in range(cases(10, 300)):
        grid = Grid(random_grid(rng, 4, 20, (0.0, 0.3)).blocked, float(rng.choice([0.05, 0.25, 1.0])))
        surroundings = around(grid, 0.4, np.zeros((2, 2)))
        for x, y in rng.uniform(-0.1, 1.05, (20, 2)) * grid.resolution * np.array(grid.shape[::-1]):
            free = naive.clearance(grid.blocked, grid.resolution, x, y)
            assert kernels.missing_clearance(surroundings, x, y, 0.4) == pytest.approx(max(0.4 - free, 0.0), abs=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_curves_and_speeds_are_those_of_the_twin(name: str) -> None:
    """Places and curvatures of SciPy's spline; speeds that bisection finds under the same limits."""
    rng, limits = np.random.default_rng(1), finite_limits(ROBOTS[name])
    for _ in range(cases(3, 60)):
        points = wandering(rng, int(rng.integers(4, 12)))
        one, spare = curve(points, 6), curve(points, 6)
        kernels.improve(one, spare, around(Grid(np.zeros((5, 5), bool)), 0.0, points), limits, 0, np.zeros(1, np.uint64))
        xy, kappa = naive.spline(points, 6)
        assert one.xy == pytest.approx(xy, abs=1e-9) and one.kappa == pytest.approx(kappa, abs=1e-6)
        assert one.ds[:-1] == pytest.approx(np.hypot(*np.diff(xy, axis=0).T), abs=1e-9)
        assert np.sqrt(one.square) == pytest.approx(np.sqrt(naive.squares(one.kappa, one.ds, limits)), abs=1e-5)


@pytest.mark.parametrize("fixed", [False, True])
def test_clearance_is_missing_where_a_disc_of_the_body_lacks_it(fixed: bool) -> None:
    """The most of any disc, placed by the path's heading or a fixed one; near ends that have less, less is asked for."""
    rng = np.random.default_rng(6)
    grid, discs = Grid(rng.random((50, 50)) < 0.02, 0.1), ((-0.2, 0.0), (0.2, 0.1))
    for _ in range(cases(3, 60)):
        points = wandering(rng, 10)
        one = curve(points, 8)
        ends = np.column_stack((points[[0, -1]], rng.uniform(0.0, 0.3, 2)))
        around_it = around(grid, 0.3, points, discs)._replace(ends=ends, fixed=fixed)
        kernels.improve(one, curve(points, 8), around_it, finite_limits(ROBOTS["diff"]), 0, np.zeros(1, np.uint64))
        for (x, y), (cos, sin), missing in zip(one.xy, one.tangent, one.missing):
            need = min(0.3, *(ends[:, 2] + 0.25 * np.hypot(*(ends[:, :2] - (x, y)).T)))
            turn = np.eye(2) if fixed else np.array([[cos, sin], [-sin, cos]])
            free = [naive.clearance(grid.blocked, 0.1, *((x, y) + disc @ turn)) for disc in np.array(discs)]
            assert missing == pytest.approx(max(need - min(free), 0.0), abs=1e-9)


@pytest.mark.parametrize("name", ["inertia", "diff", "car"])
def test_the_search_keeps_its_books(name: str) -> None:
    """After many moves, most undone, curve and cost are those computed anew; the same seed gives the same curve."""
    rng, limits = np.random.default_rng(2), finite_limits(ROBOTS[name])
    grid = Grid(rng.random((50, 50)) < 0.02, 0.1)
    for seed in range(cases(3, 60)):
        points = wandering(rng, 10)
        surroundings = around(grid, 0.3, points, ((-0.2, 0.0), (0.2, 0.1)))
        first, found, again, anew = (curve(points, 8) for _ in range(4))
        before = kernels.improve(first, curve(points, 8), surroundings, limits, 0, np.zeros(1, np.uint64))
        cost = kernels.improve(found, curve(points, 8), surroundings, limits, 60, np.array([seed], np.uint64))
        kernels.improve(again, curve(points, 8), surroundings, limits, 60, np.array([seed], np.uint64))
        assert cost < before and again.points.tobytes() == found.points.tobytes()
        anew.points[:] = found.points
        assert kernels.improve(anew, curve(points, 8), surroundings, limits, 0, np.zeros(1, np.uint64)) == pytest.approx(cost)
        for a, b in zip(found, anew):
            assert a == pytest.approx(b, abs=1e-9)


def places(rng: np.random.Generator, robot: RobotSpec) -> tuple[Grid, tuple, tuple]:
    """A random map of 10 x 10 m, sometimes turned, and two points with a path between them."""
    while True:
        grid = Grid(rng.random((40, 40)) < 0.03, 0.25, (*rng.uniform(-5, 5, 2), float(rng.choice([0.0, 0.7]))))
        room = grid.inflate(robot.radius)
        free = np.argwhere(~room.blocked)
        start, goal = (tuple(map(int, cell)) for cell in free[rng.integers(len(free), size=2)])
        path = solve(Problem(room, start, goal), "jps")
        if path.status is Status.FOUND and path.length > 2.0:
            return grid, start, goal


def sampled(grid: Grid, robot: RobotSpec, motion: Motion) -> float:
    """Least clearance of the body's outline at the knots, from every cell: sampled along the outline."""
    outline = np.zeros((1, 2))
    if robot.footprint is not None:
        corners = np.array(robot.footprint)
        outline = np.concatenate([corners + s * (np.roll(corners, -1, axis=0) - corners) for s in (0.0, 0.25, 0.5, 0.75)])
    least = math.inf
    for (x, y), heading in zip(motion.xy[::4], motion.heading[::4]):
        cos, sin = math.cos(heading), math.sin(heading)
        for px, py in outline @ np.array([[cos, sin], [-sin, cos]]) + (x, y):
            (row, col), size = grid.to_points((px, py))[0] + 0.5, grid.resolution
            least = min(least, naive.clearance(grid.blocked, size, col * size, row * size))
    return least - (robot.radius if robot.footprint is None else 0.0)


@pytest.mark.parametrize("name", ROBOTS)
def test_plans_are_bent_and_stay_drivable(name: str) -> None:
    """Plans on random maps become motions within all limits, clear of walls, and no later than with stops at corners (C29)."""
    robot, rng = ROBOTS[name], np.random.default_rng(3)
    found = asked = bent = 0
    for case in range(cases(4, 400)):
        grid, start, goal = places(rng, robot)
        path = solve(Problem(grid.inflate(robot.radius), start, goal), "jps")
        answer = smooth(path, robot, grid=grid, trials=30)
        asked += 1
        if answer.motion is None:
            assert answer.status is Status.NO_PATH and answer.reason, case
            continue
        found, bent = found + 1, bent + answer.bent
        motion = answer.motion
        check_motion(grid, robot, motion)
        assert sampled(grid, robot, motion) >= -1e-6, case
        assert motion.xy[0] == pytest.approx(grid.centre(start)) and motion.xy[-1] == pytest.approx(grid.centre(goal))
        assert motion.time <= answer.stop_time and answer.bent == (motion.time < answer.stop_time)
        assert motion.length / robot.v_max <= motion.time
    assert found >= 0.75 * asked and bent >= asked // 4


def test_a_plan_along_corners_has_stops_where_there_is_more_room() -> None:
    """Its own legs are too near to walls for the robot, so those of another plan between the same ends are taken."""
    grid, start, goal = places(np.random.default_rng(15), ROBOTS["inertia"])
    path = solve(Problem(grid.inflate(0.3), start, goal), "anyangle")
    assert straight_legs(path.xy(grid), grid, ROBOTS["inertia"]) is None
    answer = smooth(path, ROBOTS["inertia"], grid=grid, trials=1)
    check_motion(grid, ROBOTS["inertia"], answer.motion)
    assert answer.motion.time <= answer.stop_time < math.inf


def test_discs_cover_the_box_of_a_footprint() -> None:
    """They stand in a row along its longer side, and each reaches the corners of its part of the box."""
    for box in (np.array([(-0.2, -0.1), (0.7, 0.3)]), np.array([(-0.1, -0.5), (0.1, 0.1)])):
        corners = np.array([(x, y) for x in box[:, 0] for y in box[:, 1]])
        centres, radius = covering_discs(corners, 3)
        points = box[0] + np.random.default_rng(4).random((200, 2)) * np.diff(box, axis=0)
        away = np.hypot(*(np.vstack((points, corners))[:, None] - centres).transpose(2, 0, 1)).min(axis=1)
        assert away.max() == pytest.approx(radius) and np.allclose(centres.mean(axis=0), box.mean(axis=0))


def test_the_office_is_crossed_at_nearly_full_speed() -> None:
    """Robots of 1 m/s with inertia cross it within 2 % of the plan's length at full speed; stops cost 15 to 30 % more."""
    for name in ("inertia", "diff"):
        path = plan(OFFICE, (1.5, 3.0), (22.0, 12.5), robot_radius=0.3)
        answer = smooth(path, ROBOTS[name])
        assert answer.bent and answer.motion.time < 1.02 * answer.bound and answer.motion.time < 0.87 * answer.stop_time
        first, again = (smooth(path, ROBOTS[name], trials=10).motion for _ in range(2))
        assert again.xy.tobytes() == first.xy.tobytes() and again.t.tobytes() == first.t.tobytes()


def test_plans_without_a_path_and_of_one_cell() -> None:
    """No path stays none; who is there already stands."""
    wall = np.zeros((20, 20), dtype=bool)
    wall[:, 10] = True
    grid = Grid(wall, 0.25)
    none = smooth(plan(grid, (1.0, 1.0), (4.0, 1.0), robot_radius=0.3), DIFF)
    assert none.status is Status.NO_PATH and none.motion is None and none.reason
    stands = smooth(plan(grid, (1.0, 1.0), (1.0, 1.0), robot_radius=0.3), DIFF)
    assert stands.status is Status.FOUND and stands.motion.time == 0.0


def test_where_no_curve_fits_wheels_turn_in_place() -> None:
    """In the corner of a passage as wide as the robot it stops, turns and drives on; a car finds no motion."""
    blocked = np.ones((14, 14), dtype=bool)
    blocked[2:7, 2:12] = blocked[2:12, 7:12] = False  # 0.5 m wide
    grid = Grid(blocked, 0.1)
    robot = replace(DIFF, radius=0.25)
    path = solve(Problem(grid.inflate(0.25), (4, 4), (9, 9)), "jps")
    answer = smooth(path, robot, grid=grid, trials=20)
    check_motion(grid, robot, answer.motion)
    assert not answer.bent and "touches a wall" in answer.reason and answer.motion.time == answer.stop_time
    stands = np.hypot(*answer.motion.velocity.T) == 0.0
    assert np.abs(answer.motion.turn_rate[stands]).max() > 1.0
    car = replace(CAR, footprint=None, radius=0.25)
    none = smooth(path, car, grid=grid, trials=20)
    assert none.status is Status.NO_PATH and none.motion is None and none.reason


def test_stops_at_corners_are_exact() -> None:
    """Trapezoids on each leg, turns by the limits of turning; a car cannot; equal neighbours count once."""
    motion = stop_at_corners([(0.0, 0.0), (0.0, 0.0), (2.0, 0.0), (4.0, 0.0), (4.0, 0.25)], DIFF)
    turn = math.pi / 2
    spin = turn / 1.9 + 1.9 / 3.0 if turn >= 1.9**2 / 3.0 else 2 * math.sqrt(turn / 3.0)
    assert motion.time == pytest.approx(5.0 + spin + 2 * math.sqrt(0.25))
    check_motion(Grid(np.zeros((20, 40), bool), 0.25, (-2.0, -2.0, 0.0)), DIFF, motion)
    assert motion.heading[[0, -1]] == pytest.approx([0.0, turn])
    with pytest.raises(BadParameter, match=r"2 points"):
        stop_at_corners([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0)], CAR)
    glides = stop_at_corners([(0.0, 0.0), (3.0, 4.0), (3.0, 5.0)], RobotSpec(a_max=1.0))
    assert glides.time == pytest.approx(6.0 + 2.0)
    assert stop_at_corners([(0.0, 0.0), (0.24, 0.0)], RobotSpec(a_max=1.0, brake_max=3.0)).time == pytest.approx(0.6 + 0.2)


def broken(motion: Motion) -> dict[str, Motion]:
    """A motion with one thing wrong, by what is then said."""
    fields = {name: np.array(getattr(motion, name)) for name in ("t", "xy", "heading", "velocity", "turn_rate")}

    def changed(**changes: np.ndarray) -> Motion:
        return Motion(**({name: array.copy() for name, array in fields.items()} | changes))

    middle = len(motion.t) // 2
    aside, jump = fields["xy"].copy(), fields["xy"].copy()
    jump[middle] += 0.01
    aside[:, 1] += 0.9
    fast = changed(t=fields["t"] / 1.1, velocity=fields["velocity"] * 1.1, turn_rate=fields["turn_rate"] * 1.1)
    skid = fields["velocity"].copy()
    skid[middle] = skid[middle] @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    stops = {name: array[: middle + 1] for name, array in fields.items()}
    late = fields["t"].copy()
    late[middle] = late[middle + 1]
    return {
        "velocities lead": changed(xy=jump),
        "touches a wall": changed(xy=aside),
        "faster than v_max": fast,
        "alpha_max": fast,
        "a_max": fast,
        "moves aside": changed(velocity=skid),
        "turn rates lead": changed(turn_rate=fields["turn_rate"] + 0.3 * np.sin(np.linspace(0.0, math.pi, len(motion.t)))),
        "both ends": Motion(**stops),
        "do not increase": changed(t=late),
        "not finite": changed(heading=np.full(len(motion.t), math.nan)),
        "shape": changed(heading=fields["heading"][:-1]),
        "no array of numbers": changed(heading=np.full(len(motion.t), "east")),
    }


def test_straight_legs_leave_out_vertices_but_cut_no_wall() -> None:
    """Around a wall by the vertices that are needed; none where a disc is too wide for a leg between neighbours."""
    grid = Grid(np.array([[0, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 0]], dtype=bool), resolution=0.5)
    path = np.array([(0.25, 0.25), (0.2, 0.75), (0.25, 1.25), (0.75, 1.3), (1.75, 1.25)])
    legs = straight_legs(path, grid, RobotSpec(radius=0.1))
    assert legs is not None and legs.tolist() == path[[0, 2, 4]].tolist()
    assert straight_legs(path[[0, 4]], grid, RobotSpec(radius=0.1)) is None
    assert straight_legs(path, grid, RobotSpec(radius=0.3)) is None
    beside_the_edge = straight_legs(path[[0, 2]], Grid(np.zeros((3, 4), dtype=bool), 0.5), RobotSpec(radius=0.3))
    assert beside_the_edge is None, "what is off the map counts as a wall"


def test_motions_with_stops_start_with_the_heading_of_the_first_leg() -> None:
    """Wheels do not turn before they have moved; what has a footprint and no wheels keeps the heading of the map."""
    for name, turns in (("diff", True), ("jackal", True), ("inertia", True), ("box", False)):
        ahead = stop_at_corners([(1.0, 1.0), (3.0, 1.0)], ROBOTS[name])
        motion = stop_at_corners([(1.0, 1.0), (1.0, 3.0)], ROBOTS[name])
        assert motion.time == pytest.approx(ahead.time) and np.allclose(motion.heading, math.pi / 2 if turns else 0.0)


def test_wheels_turn_the_short_way_from_any_heading() -> None:
    """A path and the same turned by half a turn, whose headings pass from 180 to -180 degrees, take the same time."""
    path = np.array([(0.0, 0.0), (-4.0, 0.1), (-8.0, 0.0), (-12.0, 0.1)])
    assert stop_at_corners(path, DIFF).time == pytest.approx(stop_at_corners(-path, DIFF).time, abs=1e-9)


def test_straight_legs_take_the_least_time() -> None:
    """Against all choices among six vertices, on random maps."""
    rng, robot = np.random.default_rng(3), RobotSpec(radius=0.1, a_max=1.0)
    for _ in range(cases(20, 1000)):
        grid, xy, best = Grid(rng.random((6, 6)) < 0.2, 0.5), rng.uniform(0.15, 2.85, (6, 2)), math.inf
        for inner in product((False, True), repeat=4):
            some = xy[[True, *inner, True]]
            if all(passes(grid, a, b, robot.radius) for a, b in pairwise(some)):
                best = min(best, stop_at_corners(some, robot).time)
        legs = straight_legs(xy, grid, robot)
        assert (math.inf if legs is None else stop_at_corners(legs, robot).time) == pytest.approx(best, rel=1e-9)


def test_the_check_rejects_every_broken_motion() -> None:
    """Each kind of fault is found and named."""
    motion = smooth(plan(OFFICE, (1.5, 3.0), (22.0, 12.5), robot_radius=0.3), DIFF).motion
    check_motion(OFFICE, DIFF, motion)
    for what, wrong in broken(motion).items():
        with pytest.raises(InvalidPlan, match=what):
            check_motion(OFFICE, DIFF, wrong)
    with pytest.raises(InvalidPlan, match="tighter than turning_radius"):
        check_motion(OFFICE, replace(DIFF, drive="ackermann", turning_radius=3.0), motion)
    with pytest.raises(InvalidPlan, match="turn_rate"):
        check_motion(OFFICE, replace(DIFF, turn_rate=0.5), motion)
    with pytest.raises(InvalidPlan, match="begins in a wall"):
        check_motion(Grid(np.ones(OFFICE.shape, bool), OFFICE.resolution), DIFF, motion)


def moved(dt: float, x: np.ndarray, v: np.ndarray) -> Motion:
    """A motion along x with even knots."""
    still = np.zeros(len(x))
    return Motion(dt * np.arange(len(x)), np.column_stack((2.0 + x, 5.0 + still)), still, np.column_stack((v, still)), still)


def test_the_check_rejects_drift_spin_and_reversals_within_a_step() -> None:
    """Small misses of many knots add up; a holonomic footprint does not turn; within a step to and fro wheels brake first."""
    room, still, here = Grid(np.zeros((10, 10), dtype=bool)), np.zeros(2001), np.full((2001, 2), 5.0)
    for dt in (1e-4, 0.01):
        with pytest.raises(InvalidPlan, match="velocities lead"):
            check_motion(room, ROBOTS["inertia"], moved(dt, 0.0009 * np.arange(2001), still))
    for name in ("inertia", "diff"):
        motion = stop_at_corners([(2.0, 5.0), (5.0, 5.0)], ROBOTS[name])
        with pytest.raises(InvalidPlan, match="is faster than v_max"):
            check_motion(room, replace(ROBOTS[name], v_max=0.9), motion)
    with pytest.raises(InvalidPlan, match="is faster than v_max or v_reverse"):
        check_motion(
            room, ROBOTS["diff"], Motion(motion.t, motion.xy, motion.heading + math.pi, motion.velocity, motion.turn_rate)
        )
    for miss, legal in ((0.9, True), (1.1, False)):  # of 1 % of 8 m and of a millimetre, in all
        v = np.minimum(np.arange(1001), np.arange(1001)[::-1]).clip(max=100) / 100
        x = np.append(0.0, np.cumsum(v[1:] + v[:-1]) * 0.5e-2)
        drifts = moved(0.01, x + miss * (0.01 * x[-1] + 1e-3) * np.arange(1001) / 1000, v)
        with nullcontext() if legal else pytest.raises(InvalidPlan, match="velocities lead"):
            check_motion(Grid(np.zeros((10, 20), dtype=bool)), ROBOTS["inertia"], drifts)
    slow = moved(0.01, 1e-5 * np.arange(2001), still)
    with pytest.raises(InvalidPlan, match="velocities lead"):
        check_motion(room, ROBOTS["inertia"], slow)
    with pytest.raises(InvalidPlan, match="turn rates lead"):
        check_motion(room, DIFF, Motion(slow.t, here, slow.xy[:, 0].copy(), slow.velocity, slow.turn_rate))
    spin = Motion(np.arange(3.0), here[:3], np.array([0.0, 25.0, 50.0]), np.zeros((3, 2)), np.array([0.0, 50.0, 0.0]))
    with pytest.raises(InvalidPlan, match="keeps its heading"):
        check_motion(room, ROBOTS["box"], spin)
    v = np.array([0.0, 0.5, 0.5, 1.0, -1.0, -0.5, 0.0]) / 2.0
    x = np.concatenate(([0.0], np.cumsum(v[1:] + v[:-1]) / 2.0))
    wheels = RobotSpec(drive="differential", v_reverse=1.0, a_max=1.0)
    check_motion(room, wheels, moved(1.0, x, v))
    for limit in ("a_max", "brake_max"):
        with pytest.raises(InvalidPlan, match=limit):
            check_motion(room, replace(wheels, **{"brake_max": 1.0, limit: 0.6}), moved(1.0, x, v))


@pytest.mark.parametrize("end", [0.5, -0.5])
def test_a_car_that_turns_while_it_stands_amid_a_step_is_refused(end: float) -> None:
    """Its speed changes its sign within the step: there its turn rate must be 0, as it is if it stays on one arc."""
    car = RobotSpec(drive="ackermann", turning_radius=1.0, v_reverse=1.0, a_max=1.0, alpha_max=1.0)
    t, v, w = np.array([0.0, 0.5, 1.5, 2.0]), np.array([0.0, 0.5, -0.5, 0.0]), np.array([0.0, 0.5, end, 0.0])
    fine = np.linspace(0.0, 2.0, 200_001)
    speed, rate, dt = np.interp(fine, t, v), np.interp(fine, t, w), fine[1]
    heading = np.concatenate(([0.0], np.cumsum(rate[1:] + rate[:-1]) * dt / 2.0))
    moves = speed[:, None] * np.column_stack((np.cos(heading), np.sin(heading)))
    xy = np.concatenate(([[5.0, 5.0]], 5.0 + np.cumsum(moves[1:] + moves[:-1], axis=0) * dt / 2.0))
    at = np.searchsorted(fine, t - dt / 2.0)
    motion, room = Motion(t, xy[at], heading[at], moves[at], w), Grid(np.zeros((10, 10), dtype=bool))
    check_motion(room, replace(car, drive="differential", turning_radius=0.0), motion)
    if end < 0.0:
        check_motion(room, car, motion)
    else:
        with pytest.raises(InvalidPlan, match="turns while it stands"):
            check_motion(room, car, motion)


def test_walls_are_checked_between_knots() -> None:
    """A post of one cell between two knots 4 m apart is found, and so is a corner that sweeps out in a turn in place."""
    blocked = np.zeros((40, 60), dtype=bool)
    blocked[20, 30] = True
    grid = Grid(blocked, 0.1)
    across = stop_at_corners([(0.5, 2.05), (5.5, 2.05)], RobotSpec(a_max=1.0))
    with pytest.raises(InvalidPlan, match="touches a wall"):
        check_motion(grid, RobotSpec(a_max=1.0), across)
    check_motion(
        grid, replace(RobotSpec(a_max=1.0), radius=0.2), stop_at_corners([(0.5, 2.35), (5.5, 2.35)], RobotSpec(a_max=1.0))
    )
    long = replace(DIFF, footprint=((-0.6, -0.1), (0.6, -0.1), (0.6, 0.1), (-0.6, 0.1)))
    turns = stop_at_corners([(1.0, 1.0), (3.05, 1.6), (3.06, 3.0)], long)
    beside = Grid(np.roll(blocked, (-4, 4), axis=(0, 1)), 0.1)  # at (3.45, 1.65)
    with pytest.raises(InvalidPlan, match="touches a wall"):
        check_motion(beside, long, turns)


def test_a_body_beside_its_centre_of_rotation_is_what_must_be_free() -> None:
    """A boom a metre ahead may not begin amid a block; where its centre of rotation is, there may be a block."""
    blocked = np.zeros((60, 100), dtype=bool)
    blocked[10:50, 30:60] = True
    boom = RobotSpec(a_max=1.0, footprint=((1.0, -0.1), (1.3, -0.1), (1.3, 0.1), (1.0, 0.1)))
    for turn in (0.0, 0.7):
        about = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
        grid = Grid(blocked, 0.1, (0.0, 0.0, turn))
        for x, legal in ((2.95, False), (5.5, True)):
            for motion in (moved(0.2, np.array([0.0, -0.01]), np.zeros(2)), moved(0.2, np.zeros(1), np.zeros(1))):
                there = (motion.xy - motion.xy[0] + (x, 3.0)) @ about
                motion = Motion(motion.t, there, motion.heading + turn, motion.velocity, motion.turn_rate)
                try:
                    check_motion(grid, boom, motion)
                    faults = ""
                except InvalidPlan as error:
                    faults = str(error)
                assert ("begins in a wall" in faults) != legal and ("wall" in faults) != legal, (turn, x, faults)


def test_bodies_of_millimetres_do_not_pass_walls_unseen() -> None:
    """Neither through a wall that is thinner than a step, nor past a corner; sliding along a wall touches nothing."""
    blocked = np.zeros((40, 60), dtype=bool)
    blocked[:, 30] = True
    slow = RobotSpec(a_max=1.0, radius=2e-4, v_max=0.01)
    thin = Grid(blocked, 2.5e-4)
    for far in (5e-4, 9e-4, 3e-3):
        across = stop_at_corners([(7.6e-3 - far / 2, 5e-3), (7.65e-3 + far / 2, 5e-3)], slow)
        with pytest.raises(InvalidPlan, match="touches a wall"):
            check_motion(thin, slow, across)
    for radius in (3e-3, 1e-3, 1e-7):
        walls = np.zeros((40, 60), dtype=bool)
        walls[:20, 30:] = True
        grid, small = Grid(walls, 0.01), RobotSpec(a_max=1.0, radius=radius)
        reach = radius / math.sqrt(2.0)
        for deep, legal in ((-2e-5, True), (min(3e-4, radius), False)):
            x, y = 0.3 - reach + deep, 0.2 + reach - deep  # the middle of a motion at 45 degrees past the corner (0.3, 0.2)
            past = stop_at_corners([(x - 4e-4, y - 4e-4), (x + 4e-4, y + 4e-4)], small)
            if legal:
                check_motion(grid, small, past)
            else:
                with pytest.raises(InvalidPlan, match="touches a wall"):
                    check_motion(grid, small, past)
    small = RobotSpec(a_max=1.0, radius=0.05)
    check_motion(Grid(np.zeros((10, 400), bool), 0.01), small, stop_at_corners([(0.1, 0.05), (3.9, 0.05)], small))


def test_a_body_does_not_drift_over_a_wall() -> None:
    """Where a knot is a little off from where its step leads, what lies between the two counts as passed."""
    blocked = np.zeros((40, 60), dtype=bool)
    blocked[:, 30] = True
    grid, slow = Grid(blocked, 2.5e-4), RobotSpec(a_max=1.0, radius=1e-4, v_max=10.0)
    jump = Motion(
        np.array([0.0, 0.1]), np.array([(7.39e-3, 5e-3), (7.86e-3, 5e-3)]), np.zeros(2), np.zeros((2, 2)), np.zeros(2)
    )
    with pytest.raises(InvalidPlan, match=r"touches a wall at 0\.05 s"):
        check_motion(grid, slow, jump)
    blocked = np.zeros((40, 4100), dtype=bool)
    blocked[12, 3960] = True  # at 0.49 mrad from the place of the bar
    thin = RobotSpec(drive="differential", footprint=((0.0, -1e-4), (1.0, -1e-4), (1.0, 1e-4), (0.0, 1e-4)))
    still = np.zeros((2, 2))
    turn = Motion(np.array([0.0, 0.1]), np.full((2, 2), 2.7e-3), np.array([0.0, 9.8e-4]), still, np.zeros(2))
    check_motion(Grid(np.roll(blocked, 5, axis=0), 2.5e-4), thin, turn)
    with pytest.raises(InvalidPlan, match=r"touches a wall at 0\.05 s"):
        check_motion(Grid(blocked, 2.5e-4), thin, turn)


def test_the_command_smooths(tmp_path) -> None:
    """`antway plan --smooth` prints, draws and gives the motion as JSON; what it needs and does not take is said."""
    asked = ["plan", "office", "--start", "1.5,3", "--goal", "8.5,7"]
    result = CliRunner().invoke(app, [*asked, "--robot", "diff", "--smooth", "--json", "--out", str(tmp_path / "motion.png")])
    record = json.loads(result.stdout)
    assert result.exit_code == 0 and record["bent"] and record["time"] < record["stop_time"]
    assert (tmp_path / "motion.png").stat().st_size > 10_000
    motion = Motion(**{name: np.array(values) for name, values in record["motion"].items()})
    check_motion(OFFICE, DIFF, motion)
    assert record["motion_length"] == pytest.approx(motion.length) and record["motion_length"] < record["length"]
    words = CliRunner().invoke(app, [*asked, "--robot", "turtlebot4", "--smooth"])
    assert "along a curve" in words.stdout and "at full speed" in words.stdout
    for wrong in (
        ["--smooth"],
        ["--smooth", "--robot", "diff", "--radius", "0.3"],
        ["--smooth", "--robot", "diff", "--pareto"],
    ):
        with pytest.raises(BadParameter, match=r"smooth|radius"):
            CliRunner().invoke(app, [*asked, *wrong], catch_exceptions=False)


def test_wrong_input_raises() -> None:
    """Numbers out of range, a map that is too small, and a plan that knows no map."""
    path = plan(OFFICE, (1.5, 3.0), (22.0, 12.5), robot_radius=0.3)
    for wrong in ({"margin": -0.1}, {"trials": 0}, {"seed": -1}, {"grid": 3}, {"grid": Grid([[False]])}):
        with pytest.raises(BadParameter, match=next(iter(wrong))):
            smooth(path, DIFF, **wrong)
    with pytest.raises(BadParameter, match="grid"):
        smooth(replace(path, grid=None), DIFF)
    for changed in (
        {"cells": path.cells - 200},
        {"points": np.array([[3.0, 3.0], [1e12, 3.0]])},
        {"points": np.full((2, 2), math.nan)},
    ):
        with pytest.raises(BadParameter, match=r"grid\.shape"):
            smooth(replace(path, **changed), DIFF)
    for changed in ({"cells": np.zeros((3, 3), int)}, {"cells": np.array(3)}, {"cells": np.ones((2, 2))}):
        with pytest.raises(BadParameter, match=r"path\.cells = .*integers of shape"):
            smooth(replace(path, **changed), DIFF)
    for points in (np.zeros((2, 3)), np.zeros((0, 2)), np.array([["a", "b"]])):
        with pytest.raises(BadParameter, match=r"path\.points = .*numbers of shape"):
            smooth(replace(path, points=points), DIFF)
    for far in ((0.0, -1.1e10), (1e200, 0.0)):
        with pytest.raises(BadParameter, match=r"points .*1e\+10"):
            stop_at_corners([(0.0, 0.0), far, (far[1], far[0])], DIFF)
    for name, points, robot in (("points", np.empty((0, 2)), DIFF), ("robot", [(0.0, 0.0)], 3)):
        with pytest.raises(BadParameter, match=name):
            stop_at_corners(points, robot)


@pytest.mark.parametrize("drive", ["holonomic", "differential"])
def test_a_path_that_comes_back_to_a_vertex_is_smoothed(drive: str) -> None:
    """Out and back, a round, and the figure of an eight are legal plans."""
    grid, robot = Grid(np.zeros((20, 40), dtype=bool), 0.25), RobotSpec(drive=drive, a_max=1.0, alpha_max=3.0)
    out, across, corner = (10, 5), (10, 20), (15, 20)
    eight = [out, across, (15, 25), (10, 30), (5, 25), across, (10, 10)]
    for vertices in ([out, across, out], [out, across, corner, (15, 5), out], eight):
        legs = [np.linspace(a, b, max(abs(np.subtract(a, b))) + 1)[1:] for a, b in pairwise(vertices)]
        cells = np.vstack((vertices[:1], *legs)).astype(np.int32)
        loop = Plan(Status.FOUND, cells, float(np.hypot(*np.diff(cells, axis=0).T).sum()) * grid.resolution)
        check_plan(Problem(grid, vertices[0], vertices[-1]), loop)
        found = smooth(loop, robot, grid=grid, trials=5)
        check_motion(grid, robot, found.motion)


def test_vertices_that_say_nothing_are_left_out() -> None:
    """Those that equal the one before, and those on a straight line; the path may turn back."""
    xy = np.array([(0, 0), (0, 0), (1, 0), (3, 0), (3, 1), (3, 1), (3, 2), (4, 3), (6, 5), (5, 4), (5, 4)], float)
    assert without_repeats(xy).tolist() == [[0, 0], [3, 0], [3, 2], [6, 5], [5, 4]]
    assert len(without_repeats(np.zeros((3, 2)))) == 1 and len(without_repeats(np.empty((0, 2)))) == 0


def test_vertices_in_nearly_the_same_place_count_once() -> None:
    """A plan of another maker may have points a fraction of a nanometre apart, at which no robot can stop in between."""
    grid, cells = Grid(np.zeros((9, 9), dtype=bool)), np.array([(1, 1), (2, 1), (3, 1)], np.int32)
    points = np.array([(1.0, 1.0), (1.0 + 1e-11, 1.0 + 1e-10), (3.0, 1.0)])
    found = smooth(Plan(Status.FOUND, cells, 2.0, points=points), RobotSpec(), grid=grid, trials=1)
    assert found.motion.length == pytest.approx(2.0)


def test_a_path_of_many_kilometres_is_refused() -> None:
    """The memory for its control points has no bound otherwise."""
    path = plan(Grid(np.zeros((3, 30), bool), 1000.0), (500.0, 1500.0), (29_500.0, 1500.0), robot_radius=0.3)
    with pytest.raises(TooLarge, match=r"path\.length"):
        smooth(path, load_robot("diff"))


def test_a_motion_keeps_arrays_of_its_own() -> None:
    """It made those that it was given read-only, and could not be made of lists."""
    t, still = np.array([0.0, 1.0]), [0.0, 0.0]
    motion = Motion(t, [(1.0, 1.0), (1.0, 1.0)], still, np.zeros((2, 2)), still)  # type: ignore[arg-type]
    check_motion(Grid(np.zeros((9, 9), dtype=bool)), RobotSpec(), motion)
    assert t.flags.writeable and not motion.t.flags.writeable and motion.time == 1.0
    with pytest.raises(BadParameter, match="heading"):
        Motion(t, np.zeros((2, 2)), [[0.0], []], np.zeros((2, 2)), t)  # type: ignore[arg-type]
