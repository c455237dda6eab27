"""An independent check of motions: the robot's limits at every instant, and its distance to walls in continuous time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, cast

import numpy as np
import scipy
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, InvalidPlan
from antway.grid import Grid
from antway.verify_motion import EVEN, REST, array_faults, braking, exceeds, gap_from_square

if TYPE_CHECKING:
    from antway.trajectory.motion import Motion
    from antway.world.robots import RobotSpec

_NEAR = 1e-6  # m, m/s, rad/s; tolerance of limits
_DRIFT = 1e-3  # m, rad; by how much the integrated velocity of a step may miss the next knot
_FRACTION = 0.01  # and as a share of how far the robot may go in this step; all steps together, of how far they go
_UNSEEN = 1e-5  # m; depth of a contact between samples that may go unseen; less for bodies or cells that are hardly larger
_MOST = 20_000  # steps that are divided together; bounds memory where a body slides along a wall for long
_AT_ONCE = 1e3  # m/s^2, rad/s^2; value used for infinite limits
_NODES = np.array([-0.8611363115940526, -0.3399810435848563, 0.3399810435848563, 0.8611363115940526])
_WEIGHTS = np.array([0.3478548451374538, 0.6521451548625461, 0.6521451548625461, 0.3478548451374538])

Floats = NDArray[np.float64]


def check_motion(grid: Grid, robot: RobotSpec, motion: Motion) -> None:
    """Raise `InvalidPlan` with all violations of a robot's limits by a motion, and its contacts with walls.

    Parameters
    ----------
    grid : Grid
        The map, not inflated; everything off the map counts as a wall.
    robot : RobotSpec
        Infinite limits of acceleration count as 1000 m/s^2 and rad/s^2.
    motion : Motion

    Raises
    ------
    BadParameter
        For arguments of another type.
    InvalidPlan
        If times do not increase from 0; if the robot does not stand at both ends; if velocities do not lead from knot to knot,
        wheels move sideways, or a holonomic robot with a footprint turns; if a limit of speed, acceleration, braking, turning
        or turning radius is exceeded; or if the body (a disc, or the turned footprint) touches a wall. Walls are checked in
        continuous time: steps are divided until every point of the body moves less than the distance to walls, or less than a
        millimetre.
    """
    checks.instance("grid", grid, Grid)
    if not hasattr(robot, "braking"):
        raise BadParameter("robot", robot, "a RobotSpec")
    if not hasattr(motion, "turn_rate"):
        raise BadParameter("motion", motion, "a Motion")
    faults = _shape_faults(motion) or [*_limit_faults(robot, motion), *_wall_faults(grid, robot, motion)]
    if faults:
        raise InvalidPlan(faults)


def _shape_faults(motion: Motion) -> list[str]:
    n = np.size(motion.t)
    shapes = {"t": (n,), "xy": (n, 2), "heading": (n,), "velocity": (n, 2), "turn_rate": (n,)}
    faults = array_faults(motion, shapes, shapes)
    if not faults and (n == 0 or motion.t[0] != 0.0 or (np.diff(motion.t) <= 0.0).any()):
        faults.append("times do not increase from 0")
    return faults


def _speeds(robot: RobotSpec, motion: Motion) -> Floats:
    """Return the speed of wheels along the heading, else the velocity, float64[N, 1 or 2]."""
    if robot.drive == "holonomic":
        return motion.velocity
    ahead = np.column_stack((np.cos(motion.heading), np.sin(motion.heading)))
    speed: Floats = (motion.velocity * ahead).sum(axis=1, keepdims=True)
    return speed


def _limit_faults(robot: RobotSpec, motion: Motion) -> Iterator[str]:
    dt, wheels = np.diff(motion.t), robot.drive != "holonomic"
    speed, rate = _speeds(robot, motion), motion.turn_rate
    speed = np.where(np.abs(speed) <= REST, 0.0, speed)  # a speed of 0 that is rounded is no reversal
    ends = np.abs(speed[[0, -1]]).max() + np.abs(rate[[0, -1]]).max()
    if ends > _NEAR:
        yield "does not stand at both ends"
    if wheels:
        yield from _wheel_faults(robot, motion, speed[:, 0])
    else:
        yield from exceeds("is faster than v_max", np.hypot(*speed.T), robot.v_max, motion.t, "m/s")
        if robot.footprint is not None and max(np.abs(rate).max(), np.ptp(motion.heading)) > _NEAR:
            yield "turns, and a holonomic robot with a footprint keeps its heading"
    change, grow, brake = np.diff(speed, axis=0), min(robot.a_max, _AT_ONCE), min(braking(robot), _AT_ONCE)
    most = np.where((speed[1:] * change).sum(axis=1) <= (0.0 if wheels else EVEN), brake, grow)
    if wheels:  # amid a step that ends in the other direction they brake first
        most[speed[:-1, 0] * speed[1:, 0] < 0.0] = min(brake, grow)
    if (np.sqrt((change**2).sum(axis=1)) > most * dt * (1 + _NEAR) + 1e-12).any():
        yield "accelerates with more than a_max or brakes with more than brake_max"
    if len(dt):
        after = _poses(robot, motion, np.arange(len(dt)), dt)
        if _drifts(np.hypot(*(after[:, :2] - motion.xy[1:]).T), np.sqrt((speed**2).sum(axis=1)), robot.v_max, dt):
            yield "a place is not where the velocities lead"
        if wheels and _drifts(np.abs(after[:, 2] - motion.heading[1:]), np.abs(rate), robot.turn_rate, dt):
            yield "a heading is not where the turn rates lead"


def _wheel_faults(robot: RobotSpec, motion: Motion, speed: Floats) -> Iterator[str]:
    """Yield what wheels cannot do at these speeds along the heading, float64[N], m/s."""
    dt, rate = np.diff(motion.t), motion.turn_rate
    aside = motion.velocity[:, 1] * np.cos(motion.heading) - motion.velocity[:, 0] * np.sin(motion.heading)
    if np.abs(aside).max() > _NEAR:
        yield "moves aside, which wheels do not"
    yield from exceeds("is faster than v_max or v_reverse", speed, robot.v_max, motion.t, "m/s")
    yield from exceeds("is faster than v_max or v_reverse, backwards", -speed, robot.v_reverse, motion.t, "m/s")
    yield from exceeds("turns faster than turn_rate", np.abs(rate), robot.turn_rate, motion.t, "rad/s")
    if robot.turning_radius > 0.0 and (np.abs(rate) > np.abs(speed) / robot.turning_radius + _NEAR).any():
        yield "turns tighter than turning_radius"
    turned = np.flatnonzero(speed[:-1] * speed[1:] < 0.0)  # steps amid which the wheels stand, after this share of their time
    share = speed[turned] / (speed[turned] - speed[turned + 1])
    if robot.turning_radius > 0.0 and (np.abs(rate[turned] + share * np.diff(rate)[turned]) > _NEAR).any():
        yield "turns while it stands, which a turning_radius rules out"
    if (np.abs(np.diff(rate)) > min(robot.alpha_max, _AT_ONCE) * dt * (1 + _NEAR) + 1e-12).any():
        yield "turns with more than alpha_max"


def _drifts(missed: Floats, speed: Floats, limit: float, dt: Floats) -> bool:
    """Tell whether steps miss the next knot by more than computing with knots explains, one or all together."""
    moved = ((speed[:-1] + speed[1:]) / 2.0 * dt).sum()
    alone = missed <= np.minimum(_FRACTION * limit * dt + _NEAR, _DRIFT)
    return not (alone.all() and missed.sum() <= _FRACTION * moved + _DRIFT)


def _poses(robot: RobotSpec, motion: Motion, step: NDArray[np.int64], after: Floats) -> Floats:
    """Return the poses (x, y, heading), float64[M, 3], at `after` s into the given steps."""
    dt = np.diff(motion.t)[step]
    speed, rate = _speeds(robot, motion), motion.turn_rate
    gain, spin = (speed[step + 1] - speed[step]) / dt[:, None], (rate[step + 1] - rate[step]) / dt
    heading = motion.heading[step] + (rate[step] + spin * after / 2.0) * after
    if robot.drive == "holonomic":
        moved = (speed[step] + gain * after[:, None] / 2.0) * after[:, None]
        return np.column_stack((motion.xy[step] + moved, heading))
    when = after[:, None] * (_NODES + 1.0) / 2.0
    angle = motion.heading[step][:, None] + (rate[step][:, None] + spin[:, None] * when / 2.0) * when
    part = (speed[step] + gain * when) * _WEIGHTS * after[:, None] / 2.0
    moved = np.column_stack(((part * np.cos(angle)).sum(axis=1), (part * np.sin(angle)).sum(axis=1)))
    return np.column_stack((motion.xy[step] + moved, heading))


def _wall_faults(grid: Grid, robot: RobotSpec, motion: Motion) -> Iterator[str]:
    """Halve steps until in none of them a point of the body can reach a wall from the gaps at both ends and return."""
    walls, n = _Walls(grid, robot), len(motion.t)
    if walls.inside(motion.xy[0], motion.heading[0]):
        yield "begins in a wall"
        return
    gap = walls.gaps(np.column_stack((motion.xy, motion.heading)))
    if gap.min() < -walls.contact:
        yield f"touches a wall at {motion.t[int(np.argmin(gap))]:.2f} s"
        return
    if n < 2:
        return
    dt = np.diff(motion.t)
    # A step ends beside the next knot. The body is led there evenly, so that it does not jump over a wall.
    missed = (np.column_stack((motion.xy, motion.heading))[1:] - _poses(robot, motion, np.arange(n - 1), dt)) / dt[:, None]
    fastest = np.sqrt((_speeds(robot, motion) ** 2).sum(axis=1)) + np.abs(motion.turn_rate) * robot.radius
    fastest = np.maximum(fastest[:-1], fastest[1:])  # speeds are linear, or convex, between knots
    fastest += np.hypot(missed[:, 0], missed[:, 1]) + np.abs(missed[:, 2]) * robot.radius
    parts = [(np.arange(n - 1), np.zeros(n - 1), dt, gap[:-1], gap[1:])]
    while parts:
        step, low, high, before, beyond = parts.pop()
        open_ = fastest[step] * (high - low) - np.maximum(before, 0.0) - np.maximum(beyond, 0.0) > 2.0 * walls.unseen
        if open_.sum() > _MOST:
            half = len(step) // 2
            parts += [(step[at], low[at], high[at], before[at], beyond[at]) for at in (slice(half, None), slice(half))]
            continue
        step, low, high, before, beyond = step[open_], low[open_], high[open_], before[open_], beyond[open_]
        if not len(step):
            continue
        middle = (low + high) / 2.0
        gap = walls.gaps(_poses(robot, motion, step, middle) + missed[step] * middle[:, None])
        if gap.min() < -walls.contact:
            worst = int(np.argmin(gap))
            yield f"touches a wall at {motion.t[step[worst]] + middle[worst]:.2f} s"
            return
        ends = np.append(low, middle), np.append(middle, high), np.append(before, gap), np.append(gap, beyond)
        parts.append((np.tile(step, 2), *ends))


class _Walls:
    """The outer blocked cells, which a body that starts outside must touch first, and the map's edges."""

    def __init__(self, grid: Grid, robot: RobotSpec) -> None:
        self.grid, self.size = grid, grid.resolution
        padded = np.pad(grid.blocked, 1)
        hidden = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
        cells = np.argwhere(grid.blocked & ~hidden)
        self.middles = (cells[:, ::-1] + 0.5) * self.size
        self.tree = scipy.spatial.cKDTree(self.middles) if len(cells) else None
        self.corners = np.zeros((1, 2)) if robot.footprint is None else np.array(robot.footprint)
        self.rounding = robot.radius if robot.footprint is None else 0.0
        self.far = robot.radius + 2.0 * self.size + _NEAR  # farther cell centres do not matter
        thin = self.rounding or math.inf  # a disc in a wall is no deeper in it than its radius
        self.contact, self.unseen = min(_NEAR, thin / 4.0), min(_UNSEEN, thin / 4.0, self.size / 4.0)

    def inside(self, xy: Floats, heading: float) -> bool:
        """Tell whether the middle of the body, which need not be its centre of rotation, is in a wall or off the map."""
        x, y = self.corners.mean(axis=0)
        c, s = math.cos(heading), math.sin(heading)
        middle = xy + np.array((c * x - s * y, s * x + c * y))
        (row, col), shape = np.floor(self.grid.to_points(middle)[0] + 0.5).astype(int), self.grid.shape
        return not (0 <= row < shape[0] and 0 <= col < shape[1]) or bool(self.grid.blocked[row, col])

    def gaps(self, poses: Floats) -> Floats:
        """Return a lower bound of the gap to walls for each pose (x, y, heading), m; below 0 where they overlap.

        For polygons it is the widest gap along the normals of either one, limited by the distance up to which cells count.
        """
        place = (self.grid.to_points(poses[:, :2]) + 0.5)[:, ::-1] * self.size  # relative to the map's corner, along its axes
        heading = poses[:, 2] - self.grid.origin[2]
        c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
        xs = place[:, :1] + c * self.corners[:, 0] - s * self.corners[:, 1]
        ys = place[:, 1:] + s * self.corners[:, 0] + c * self.corners[:, 1]
        rows, cols = self.grid.shape
        edges = np.minimum.reduce([xs, ys, cols * self.size - xs, rows * self.size - ys]).min(axis=1) - self.rounding
        gap: Floats = np.minimum(edges, self.size / 2.0)
        if self.tree is None:
            return gap
        near = [np.asarray(one, np.int64) for one in cast("list[list[int]]", self.tree.query_ball_point(place, self.far))]
        pose = np.repeat(np.arange(len(poses)), [len(one) for one in near])
        if not len(pose):
            return gap
        middle = self.middles[np.concatenate(near)]
        apart = gap_from_square(xs[pose] - middle[:, :1], ys[pose] - middle[:, 1:], self.size / 2.0)
        np.minimum.at(gap, pose, apart - self.rounding)
        return gap
