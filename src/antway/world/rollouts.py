"""What rollouts of controls know: the map as fields of distance and time, and the robot's state when a command acts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from antway.grid import Grid
from antway.kernels.base.arrays import Floats
from antway.kernels.base.records import RobotLimits, RobotState
from antway.kernels.controls.abreast import BATCH, ROWS
from antway.kernels.controls.fields import beyond_walls, fitting_poses, turning_times, wall_distance
from antway.kernels.controls.problem import Batch, ControlProblem, CostWeights, NearObstacle, Outlook, StaticField
from antway.kernels.controls.seeds import descent_points
from antway.world.manoeuvres import manoeuvre_losses
from antway.world.policy import XY, Observation, Task
from antway.world.robots import RobotSpec

_NODE = 0.025  # m; largest distance of nodes at which distances to walls are exact
_NODES = 4_000_000  # limit of nodes
_NEAR = 1.0  # m; within this distance times are those to the goal itself; the effect fades up to twice the distance
_MOST_NEAR = 200  # limit of cells on each side of the goal for that
_AIM = 0.9  # 1; share of the tolerance in which a car plans to end, since one that misses it narrowly has to manoeuvre
_LAYERS = 4  # number of cells by which the time to the goal is extended into walls
_HEADINGS = 24  # limit of headings of a car for which there are times to the goal
_FEWEST = 8  # least number of headings; with fewer, arcs cannot be told apart, and there are no such times
_SPANNED = 4  # intended number of cells of these times in a turning radius, within the limit _POSES
_FINEST = 0.25  # m; largest edge of such a cell, within the limit _POSES
_POSES = 150_000  # limit of cells times headings; so many take a few tenths of a second
_PARTS = 4  # limit of parts into which the edges of larger cells are divided
_SLACK = 0.25  # cells; a body that is in a wall by less than this at a cell's centre may have room elsewhere in the cell
_SWEEPS = 80  # limit of sweeps over all poses
_BEYOND = 0.005  # m; the discs that cover a footprint extend beyond it by this much
_FAST = 1e3  # m/s^2, rad/s^2; replaces infinite limits
_OBSTACLES = 64  # limit of obstacles that an outlook holds at one step


def finite_limits(robot: RobotSpec) -> RobotLimits:
    """Return the robot's limits, with finite numbers in place of infinite ones, and at most half a turn in a period."""
    return robot.limits._replace(
        a_max=min(robot.a_max, _FAST),
        brake_max=min(robot.braking, _FAST),
        alpha_max=min(robot.alpha_max, _FAST),
        turn_rate=min(robot.turn_rate, math.pi / robot.dt),
    )


def acting(o: Observation, robot: RobotSpec) -> tuple[Observation, RobotState]:
    """Return what is observed when a command given now acts, with the scan of now and nothing pending, and the state then."""
    state = o.state_at_action(robot)
    if robot.latency == 0.0 or o.pending is None:
        return o, state
    x, y, heading, one, two = state
    velocity, turn_rate = (one, two), o.turn_rate
    if robot.wheels:
        velocity, turn_rate = (one * math.cos(heading), one * math.sin(heading)), two
    t, place, stamp = o.t + robot.latency, (x, y), o.sensed_at
    then = replace(o, t=t, stamp=stamp, xy=place, velocity=velocity, heading=heading, turn_rate=turn_rate, pending=None)
    return then, state


def static_field(task: Task, time_to_goal: NDArray[np.float64]) -> StaticField:
    """Return the map of a task as fields for the centre of its robot.

    `time_to_goal`, float64[H, W], are the times to the goal at full speed, s; infinite where the robot cannot be.
    """
    grid, size, (x, y, _) = task.grid, task.grid.resolution, task.grid.origin
    factor = max(min(math.ceil(size / _NODE - 1e-9), math.isqrt(_NODES // grid.blocked.size)), 1)
    wall = wall_distance(grid.blocked, size, factor) - np.float32(task.robot.radius)
    frame, empty = np.array([x, y, factor / size]), np.empty((0, 0), np.float32)
    end, (box, discs) = np.array([*task.goal, _tolerance(task), math.inf]), _body(task.robot)
    losses = manoeuvre_losses(finite_limits(task.robot), _tolerance(task))
    field = StaticField(wall, frame, empty, np.zeros(3), end, box, discs, empty[None], np.zeros(3), *losses)
    return with_times(field, task, time_to_goal)


def with_times(field: StaticField, task: Task, time_to_goal: NDArray[np.float64]) -> StaticField:
    """Return the field of a task with other times to the goal; see `static_field`."""
    grid, v_max, size, (x, y, _) = task.grid, task.robot.v_max, task.grid.resolution, task.grid.origin
    near = _to_the_goal_itself(time_to_goal, grid, v_max, task.goal)
    time = _in_two_rows(beyond_walls(near - _tolerance(task) / v_max, 2.0 * size / v_max, _LAYERS))
    frame, (turning, turning_frame) = np.array([x + size / 2, y + size / 2, 1.0 / size]), _by_heading(near, field, task)
    return field._replace(time=time, time_frame=frame, turning=turning, turning_frame=turning_frame)


def _tolerance(task: Task) -> float:
    """Return how near to the goal a rollout has to come, m."""
    return task.goal_tolerance * (_AIM if task.robot.turning_radius > 0.0 else 1.0)


def empty_outlook(steps: int) -> Outlook:
    """Return an outlook on `steps` steps without obstacles and without a plan."""
    plan = np.full((steps, 3), -math.inf)
    plan[:, :2] = 0.0
    discs = np.zeros((steps + 1, _OBSTACLES, len(NearObstacle._fields)))
    return Outlook(np.zeros(steps + 1, np.int64), discs, np.zeros((steps + 1, 3, _OBSTACLES)), plan)


def make_batch(length: float, summed: bool = False) -> Batch:
    """Return memory for rollouts, and for paths of up to `length` m down the field of times to the goal.

    If `summed`, the costs of an obstacle are added up over all steps; else its worst step counts.
    """
    harm, path = np.zeros((BATCH, 0 if summed else _OBSTACLES)), np.zeros((descent_points(length), 2))
    return Batch(np.zeros(ROWS * BATCH), np.zeros(BATCH, np.int64), harm, path)


def control_problem(task: Task, times: Floats, steps: int, weights: CostWeights, batch: Batch) -> ControlProblem:
    """Return the problem of a robot at rest at (0, 0) on an empty map; the times are those of `static_field`."""
    field, limits = static_field(task, times), finite_limits(task.robot)
    start = RobotState(0.0, 0.0, 0.0, 0.0, 0.0)
    return ControlProblem(start, limits, task.robot.dt, field, empty_outlook(steps), weights, batch)


def _by_heading(
    time_to_goal: NDArray[np.float64], map_field: StaticField, task: Task
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return times of a car by heading, and their frame: `StaticField.turning` and `StaticField.turning_frame`.

    They are empty for other robots, and if the map is too large for cells on which a car's arcs can be told apart.
    """
    grid, robot = task.grid, task.robot
    if robot.turning_radius == 0.0:
        return np.empty((0, 0, 0), np.float32), np.zeros(3)
    fine = max(int(min(robot.turning_radius / _SPANNED, _FINEST) / grid.resolution), 1)  # cells that become one
    fine = max(fine, math.ceil(math.sqrt(_HEADINGS * grid.blocked.size / _POSES)))
    parts = max(math.ceil(_FEWEST * grid.resolution / (2.0 * math.pi * robot.turning_radius)), 1) if fine == 1 else 1
    size = fine * grid.resolution / parts
    headings = min(int(2.0 * math.pi * robot.turning_radius / size), _HEADINGS)
    least = time_to_goal.min()
    if headings < _FEWEST or min(grid.shape) * parts <= fine or parts > _PARTS or math.isinf(least):
        return np.empty((0, 0, 0), np.float32), np.zeros(3)
    rows, cols = (np.arange(0, side, fine) for side in grid.shape)
    times = np.minimum.reduceat(np.minimum.reduceat(time_to_goal, rows, axis=0), cols, axis=1)
    times = (times - least).repeat(parts, axis=0).repeat(parts, axis=1)
    frame = np.array([grid.origin[0] + size / 2, grid.origin[1] + size / 2, 1.0 / size])
    fits = np.ones((headings, *times.shape), np.bool_)
    if robot.footprint is not None:
        fits = fitting_poses(map_field, frame, headings, times.shape[0], times.shape[1], _SLACK * size)
    poses = turning_times(times, fits, size, robot.turning_radius, robot.turn_rate, robot.v_max, robot.v_reverse, _SWEEPS)
    field = np.array([_in_two_rows(beyond_walls(one, 2.0 * size / robot.v_max, _LAYERS)) for one in (*poses, times)])
    return field, frame


def _in_two_rows(field: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a field between whose nodes `sample` can interpolate: a single row or column stands twice."""
    return np.pad(field, [(0, int(side == 1)) for side in field.shape], mode="edge")


def static_time(field: StaticField, state: RobotState) -> float:
    """Return the time in s to the goal from the nearest cell, for a car with the nearest heading."""
    times, frame = field.time, field.time_frame
    if len(field.turning):
        headings = len(field.turning) - 1
        times = field.turning[round(state[2] * headings / (2.0 * math.pi)) % headings]
        frame = field.turning_frame
    row, col = (round((at - low) * frame[2]) for at, low in ((state[1], frame[1]), (state[0], frame[0])))
    return float(times[min(max(row, 0), times.shape[0] - 1), min(max(col, 0), times.shape[1] - 1)])


def _to_the_goal_itself(time_to_goal: NDArray[np.float64], grid: Grid, v_max: float, goal: XY) -> NDArray[np.float64]:
    """Return the times, corrected near the goal: to the goal itself instead of the centre of its cell."""
    row, col = np.unravel_index(int(np.argmin(time_to_goal)), grid.shape)
    n = min(math.ceil(2.0 * _NEAR / grid.resolution) + 3, _MOST_NEAR)
    window = np.s_[max(row - n, 0) : row + n + 1, max(col - n, 0) : col + n + 1]
    near, (rows, cols) = time_to_goal[window], (np.arange(size)[side] for size, side in zip(grid.shape, window, strict=True))
    cells = np.stack(np.meshgrid(rows, cols, indexing="ij"), axis=-1).reshape(-1, 2)
    xy, end = grid.to_xy(cells), grid.centre((int(row), int(col)))
    to_centre, to_goal = (np.hypot(*(xy - one).T).reshape(near.shape) for one in (end, goal))
    straight = near * v_max <= 1.03 * to_centre
    nearer = np.clip(2.0 - to_goal / _NEAR, 0.0, 1.0) * (to_goal - to_centre) / v_max
    # The robot may stand off the centre of a cell whose centre is too near a wall.
    off_centre = np.isinf(near) & (to_goal <= math.dist(end, goal))
    times = time_to_goal.copy()
    times[window] = np.where(off_centre, to_goal / v_max, near + np.where(straight, nearer, 0.0))
    return times


def _body(robot: RobotSpec) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a box that contains the footprint, and discs that cover it: `StaticField.box` and `StaticField.discs`."""
    (x0, y0), (x1, y1) = robot.corners.min(axis=0), robot.corners.max(axis=0)
    box = np.array([x0, x1, y0, y1, robot.radius])
    if robot.footprint is None:
        return box, np.empty((0, 3))
    x, y, radius = _covering_discs(x1 - x0, y1 - y0).T
    return box, np.column_stack((x + 0.5 * (x0 + x1), y + 0.5 * (y0 + y1), robot.radius - radius))


def _covering_discs(length: float, width: float) -> NDArray[np.float64]:
    """Return x, y and radius of discs that cover a box around the origin and extend g = `_BEYOND` m beyond its sides.

    A disc of radius r + g around a point r m from a side covers sqrt((2 r + g) g) m of it in both directions. From each corner
    on, discs grow that lie so on both its sides, each beginning where the last one ends; the widest stand in the middle.
    """
    widest, g = 0.5 * min(length, width), _BEYOND
    radii, radius = [], 0.0
    while radius < widest:
        radii.append(radius)
        covered = radius + math.sqrt((2.0 * radius + g) * g)
        radius = covered + g + math.sqrt(2.0 * (covered + g) * g)
    corners = [(i, j) for i in (-1.0, 1.0) for j in (-1.0, 1.0)]
    discs = [(i * (0.5 * length - r), j * (0.5 * width - r), r + g) for r in radii for i, j in corners]
    rest, most = 0.5 * abs(length - width), 2.0 * math.sqrt((2.0 * widest + g) * g)
    places = np.linspace(-rest, rest, math.ceil(2.0 * rest / most) + 1).tolist()
    discs += [(at, 0.0, widest + g) if length > width else (0.0, at, widest + g) for at in places]
    return np.array(discs)
