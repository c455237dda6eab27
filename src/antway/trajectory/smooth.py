"""Turns a plan into a motion along a curve, or with stops at corners if that is faster."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, InvalidPlan, TooLarge
from antway.grid import Grid
from antway.kernels.base.records import RobotLimits
from antway.kernels.base.rng import make_state
from antway.kernels.trajectory.smooth import SAMPLES, Curve, Surroundings, improve
from antway.planning import Plan, Problem, Status, solve
from antway.trajectory.motion import Motion
from antway.trajectory.profile import stop_at_corners, straight_legs, without_repeats
from antway.verify_drive import check_motion
from antway.world.robots import RobotSpec
from antway.world.rollouts import finite_limits

_SPACINGS = (0.5, 0.3)  # m; distances between control points
_MORE_SPACINGS = (0.8, 1.2, 0.4)  # m; distances tried if the first ones give no motion
_STEERING = 1.01  # factor of the turning radius, because samples may miss the tightest place
_LONGEST = 20_000.0  # m; the number of control points grows with the length of a path
_FEWEST = 8  # least number of control points
_TRIALS = 40_000  # limit of moves of control points for each search
_FINE = 16  # samples on a span of the result
_DISCS = 3  # number of discs that cover a footprint


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """The result of `smooth`.

    Attributes
    ----------
    status : Status
        FOUND with a motion; NO_PATH if none was found that the robot can drive; that of the plan if it has no path.
    motion : Motion or None
        It has passed `check_motion`.
    bent : bool
        Whether it follows a curve; else it stops at corners.
    stop_time : float
        Time in s of the motion that stops at corners; infinite if there is none.
    bound : float
        The plan's length over v_max, s.
    elapsed : float
        s.
    reason : str
        Why the fastest motion was discarded, if it was.
    """

    status: Status
    motion: Motion | None
    bent: bool = False
    stop_time: float = math.inf
    bound: float = math.inf
    elapsed: float = 0.0
    reason: str = ""

    @property
    def how(self) -> str:
        """How the motion goes, in words; empty without one."""
        if self.motion is None:
            return ""
        if math.dist(self.motion.xy[0], self.motion.xy[-1]) > self.motion.length - 1e-6:
            return "along a straight line"
        return "along a curve" if self.bent else "with a stop at each corner"

    def __repr__(self) -> str:
        return f"Smoothed({self.motion}, {self.how})" if self.motion else "Smoothed(none)"


class _Task(NamedTuple):
    """A map with its corner at (0, 0), and the robot on it."""

    grid: Grid
    robot: RobotSpec
    limits: RobotLimits
    surroundings: Surroundings
    seed: int
    trials: int


def smooth(
    path: Plan, robot: RobotSpec, *, grid: Grid | None = None, margin: float = 0.02, seed: int = 0, trials: int = 400
) -> Smoothed:
    """Turn a plan into a fast motion from stand to stand.

    Parameters
    ----------
    path : Plan
        A plan for a disc of the robot's radius. It determines the side of each obstacle, and is the initial shape.
    robot : RobotSpec
        The motion respects its limits of speed, acceleration, braking, turn rate and its change, and turning radius. Wheels
        start and end with the heading of the path and do not reverse; a holonomic robot with a footprint keeps the heading of
        the map. Infinite accelerations count as 1000 m/s^2 and rad/s^2. Latency has no effect.
    grid : Grid or None
        The map, not inflated; None: that of the plan, which is the map for plans of `antway.plan`.
    margin : float
        Distance kept from walls, m, >= 0; less where start or goal has less.
    seed : int
        Seed of the search for the shape.
    trials : int
        Number of moves tried for each control point, 1 to 10,000; fewer on very long paths.

    Raises
    ------
    BadParameter, TooLarge
        TooLarge for a path of more than 20 km.

    Examples
    --------
    >>> from antway import RobotSpec, load_map, plan
    >>> robot = RobotSpec(drive="differential", a_max=1.0, alpha_max=3.0)
    >>> found = smooth(plan(load_map("office"), (1.5, 3.0), (22.0, 12.5), robot_radius=robot.radius), robot)
    >>> found.bent, found.motion.time < found.stop_time
    (True, True)
    """
    started = time.perf_counter()
    checks.instance("path", path, Plan)
    checks.instance("robot", robot, RobotSpec)
    grid = path.grid if grid is None else checks.instance("grid", grid, Grid)
    if grid is None:
        raise BadParameter("grid", None, "a map: this plan knows none")
    margin, seed = checks.number("margin", margin, low=0.0, high=1e6, unit="m"), checks.seed(seed)
    trials = checks.integer("trials", trials, low=1, high=10_000)
    _check_places(path, grid)
    if not len(path.cells):
        return Smoothed(path.status, None, elapsed=time.perf_counter() - started, reason="the plan has no path")
    if path.length > _LONGEST:
        raise TooLarge("path.length", path.length, f"at most {_LONGEST:g} m")
    flat = Grid(grid.blocked, grid.resolution)
    limits = finite_limits(robot)
    limits = limits._replace(turning_radius=_STEERING * limits.turning_radius)
    task = _Task(flat, robot, limits, _surroundings(flat, robot, path, margin), seed, trials)
    line, legs = _lines(path, task)
    stops = None
    if legs is not None and (robot.drive != "ackermann" or len(legs) <= 2):
        stops = stop_at_corners(legs, robot)
    shapes = [one for one in (legs, line) if one is not None and len(one) > 1]
    best, reason = None, ""
    for spacings in (_SPACINGS, _MORE_SPACINGS):
        motions = [_curve(shape, spacing, task) for shape in shapes for spacing in spacings]
        if stops is not None:
            motions.append(stops)
        best, reason = _fastest(motions, flat, robot)
        if best is not None:
            break
    stop_time, bound = math.inf if stops is None else stops.time, path.length / robot.v_max
    if best is None:
        return Smoothed(Status.NO_PATH, None, False, stop_time, bound, time.perf_counter() - started, reason)
    motion = _on_map(best, grid)
    return Smoothed(Status.FOUND, motion, best is not stops, stop_time, bound, time.perf_counter() - started, reason)


def _check_places(path: Plan, grid: Grid) -> None:
    """Raise `BadParameter` unless the cells and points of a plan, which may be another maker's, are places on the map."""
    for name, places, kinds in (("cells", path.cells, "iu"), ("points", path.points, "iuf")):
        if places is None:
            continue
        if places.dtype.kind not in kinds or places.shape[1:] != (2,) or (len(places) == 0 < len(path.cells)):
            numbers = "integers" if kinds == "iu" else "numbers"
            raise BadParameter(f"path.{name}", f"{places.dtype} array of shape {places.shape}", f"{numbers} of shape (N, 2)")
        if not ((places >= -0.5) & (places <= np.array(grid.shape) - 0.5)).all():
            raise BadParameter("grid.shape", grid.shape, "that of a map with all cells and points of the path")


def _fastest(motions: list[Motion], grid: Grid, robot: RobotSpec) -> tuple[Motion | None, str]:
    """Return the fastest of the motions that pass the check, and why a faster one did not."""
    reason = ""
    for motion in sorted(motions, key=lambda one: one.time):
        try:
            check_motion(grid, robot, motion)
        except InvalidPlan as fault:
            reason = reason or str(fault)
            continue
        return motion, reason
    return None, reason


def _lines(path: Plan, task: _Task) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Return the plan's polyline, and a polyline of straight legs, for which the plan may need a little more room."""
    grid, robot = task.grid, task.robot
    line = without_repeats(path.xy(grid))
    legs = straight_legs(line, grid, robot)
    if legs is None:
        wider = grid.inflate(robot.radius + 0.75 * grid.resolution)  # then whole moves between free cells are clear
        start, goal = ((int(row), int(col)) for row, col in path.cells[[0, -1]])
        if wider.is_free(start) and wider.is_free(goal):
            other = solve(Problem(wider, start, goal), "jps")
            legs = straight_legs(other.xy(grid), grid, robot) if len(other.cells) else None
    return line, legs


def _surroundings(grid: Grid, robot: RobotSpec, path: Plan, margin: float) -> Surroundings:
    padded = np.pad(grid.blocked, 1, constant_values=True)
    inside = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    clearance = grid.clearance()
    discs, radius = np.zeros((1, 2)), robot.radius
    if robot.footprint is not None:
        discs, radius = covering_discs(robot.corners, _DISCS)
    ends = []
    for cell in path.cells[[0, -1]].tolist():
        free = float(clearance[tuple(cell)]) - robot.radius
        ends.append((*grid.centre(tuple(cell)), radius + min(max(free, 0.0), margin)))
    fixed = robot.footprint is not None and not robot.wheels
    return Surroundings(grid.blocked & ~inside, clearance, grid.resolution, radius + margin, np.array(ends), discs, fixed)


def covering_discs(corners: NDArray[np.float64], count: int) -> tuple[NDArray[np.float64], float]:
    """Return the centres, float64[count, 2], and the radius in m of equal discs that cover the box around these corners.

    They are in a row along the longer side; each covers its part of the box exactly to the corners.
    """
    low, high = corners.min(axis=0), corners.max(axis=0)
    axis = int(np.argmax(high - low))
    step = (high[axis] - low[axis]) / count
    centres = np.tile((low + high) / 2.0, (count, 1))
    centres[:, axis] = low[axis] + step * (np.arange(count) + 0.5)
    return centres, math.hypot(step, float(high[1 - axis] - low[1 - axis])) / 2.0


def _curve(line: NDArray[np.float64], spacing: float, task: _Task) -> Motion:
    """Return the fastest motion found on a spline that starts from the polyline."""
    gone = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    count = max(math.ceil(gone[-1] / spacing) + 1, _FEWEST)
    points = np.column_stack([np.interp(np.linspace(0.0, gone[-1], count), gone, line[:, axis]) for axis in (0, 1)])
    state = make_state(task.seed, count)
    trials = max(min(task.trials, _TRIALS // count), 1)
    limits = task.limits
    for samples, moves in ((SAMPLES, trials), (_FINE, 0), (_FINE, 0)):
        curve = _sampled(points, samples)
        improve(curve, _sampled(points, samples), task.surroundings, limits, moves, state)
        points = curve.points
        # At joints of spans the turn rate changes a few percent faster than allowed, so the limit is lowered accordingly.
        limits = limits._replace(alpha_max=min(limits.alpha_max, limits.alpha_max * task.limits.alpha_max / _spin(curve)))
    return _timed(curve, task)


def _spin(curve: Curve) -> float:
    """Return the greatest change of the turn rate along a curve, rad/s^2."""
    speed = np.sqrt(curve.square)
    dt = 2.0 * curve.ds[:-1] / (speed[:-1] + speed[1:])
    return max(float((np.abs(np.diff(curve.kappa * speed)) / dt).max()), 1e-9)


def _sampled(points: NDArray[np.float64], samples: int) -> Curve:
    """Return a curve with these control points; nothing else is computed yet."""
    count = (len(points) + 1) * samples + 1
    return Curve(points.copy(), np.zeros((count, 2)), np.zeros((count, 2)), *(np.zeros(count) for _ in range(6)))


def _timed(curve: Curve, task: _Task) -> Motion:
    """Return the motion along a curve, slowed down by a common factor if a limit is exceeded between samples."""
    robot, limits = task.robot, task.limits
    speed = np.sqrt(curve.square)
    dt = 2.0 * curve.ds[:-1] / (speed[:-1] + speed[1:])
    velocity, turn_rate = curve.tangent * speed[:, None], curve.kappa * speed
    heading = np.unwrap(np.arctan2(curve.tangent[:, 1], curve.tangent[:, 0]))
    if not robot.wheels:
        turn_rate = np.zeros(len(speed))
        heading = heading if robot.footprint is None else turn_rate.copy()
        change = np.diff(velocity, axis=0) / dt[:, None]
        falls = (velocity[1:] * change).sum(axis=1) <= 0.0
        rate = np.hypot(*change.T) / np.where(falls, limits.brake_max, limits.a_max)
        over = [math.sqrt(rate.max())]
    else:
        change, spin = np.diff(speed) / dt, np.abs(np.diff(turn_rate)) / dt
        rate = np.maximum(change / limits.a_max, -change / limits.brake_max)
        over = [math.sqrt(rate.max()), math.sqrt(spin.max() / limits.alpha_max), np.abs(turn_rate).max() / limits.turn_rate]
    factor = max(1.0, float(speed.max()) / limits.v_max, *over) * (1.0 + 1e-9)
    t = np.concatenate(([0.0], np.cumsum(dt))) * factor
    return Motion(t, curve.xy, heading, velocity / factor, turn_rate / factor)


def _on_map(motion: Motion, grid: Grid) -> Motion:
    """Return a motion on the map with its corner at (0, 0) in the frame of the original map."""
    x, y, yaw = grid.origin
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, sin], [-sin, cos]])
    return Motion(motion.t, motion.xy @ turn + (x, y), motion.heading + yaw, motion.velocity @ turn, motion.turn_rate)
