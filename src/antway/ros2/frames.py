"""Frames on the floor: poses (x, y, yaw) and their effect on points, tracks and maps; no ROS import."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway.errors import BadParameter
from antway.grid import Grid
from antway.kernels.base.geometry import wrap
from antway.limits import MAX_ORIGIN
from antway.planning import TimedPath
from antway.world.policy import XY, Decision, Tracks

T = TypeVar("T", float, NDArray[np.float64])
Pose = tuple[float, float, float]  # m, m, rad
HERE: Pose = (0.0, 0.0, 0.0)
_OTHER_CLOCK = 60.0  # s; odometry that seems older than this has the stamps of another clock


class Odometry(NamedTuple):
    """Where the robot is at a time, and how it moves."""

    t: float  # s
    xy: XY  # m
    velocity: XY  # m/s
    heading: float  # rad
    turn_rate: float = 0.0  # rad/s


def check_age(odometry: Odometry, now: float, most: float) -> None:
    """Raise `BadParameter` for odometry that is older than `most` s by a clock that shows `now` s.

    A stamp of 0, one that is more than a minute old and one that is newer than `now` tell nothing of the age.
    """
    age = now - odometry.t
    if odometry.t > 0.0 and most < age < _OTHER_CLOCK:
        allowed = f"at most {most:g} s by this node's clock: the network or a filter is slow, or the clocks differ"
        raise BadParameter("age of header.stamp", f"{age:.2f} s", allowed, where="Odometry")


def chain(a: Pose, b: Pose) -> Pose:
    """Return the world pose of something with the pose `b` in a frame with the world pose `a`.

    Examples
    --------
    >>> chain((1.0, 0.0, math.pi), (1.0, 0.0, 0.0))[0]
    0.0
    """
    x, y = move_point(a, b[:2])
    return x, y, wrap(a[2] + b[2])


def inverse(a: Pose) -> Pose:
    """Return the pose of the world in a frame with the world pose `a`."""
    x, y = turn(-a[2], (-a[0], -a[1]))
    return x, y, -a[2]


def turn(yaw: float, vector: tuple[T, T]) -> tuple[T, T]:
    """Return `vector` turned to the left by `yaw` rad; unchanged for 0."""
    if yaw == 0.0:
        return vector
    cos, sin = math.cos(yaw), math.sin(yaw)
    return cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]


def move_point(a: Pose, xy: XY) -> XY:
    """Return the world coordinates of the point `xy`, m, of a frame with the pose `a`."""
    x, y = turn(a[2], xy)
    return a[0] + x, a[1] + y


def shown(xy: XY) -> str:
    """Return a place, m, in words, to the centimetre."""
    return "({:.2f}, {:.2f})".format(*xy)


def move(a: Pose, xy: ArrayLike) -> NDArray[np.float64]:
    """Return the world coordinates of points `xy`, float[N, 2] in m, of a frame with the pose `a`."""
    moved: NDArray[np.float64] = _turned(a[2], np.asarray(xy, np.float64).reshape(-1, 2)) + a[:2]
    return moved


def _turned(yaw: float, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = vectors.T
    return vectors if yaw == 0.0 else np.column_stack(turn(yaw, (x, y)))


def move_odometry(a: Pose, odometry: Odometry) -> Odometry:
    """Return the odometry of a frame with the pose `a` in the world."""
    x, y, heading = chain(a, (*odometry.xy, odometry.heading))
    return odometry._replace(xy=(x, y), velocity=turn(a[2], odometry.velocity), heading=heading)


def move_tracks(a: Pose, tracks: Tracks) -> Tracks:
    """Return tracks of a frame with the pose `a` in the world; for HERE, the same object."""
    if a == HERE:
        return tracks
    covariance = tracks.covariance
    if covariance is not None:
        cos, sin = math.cos(a[2]), math.sin(a[2])
        both = np.kron(np.eye(2), np.array([[cos, -sin], [sin, cos]]))
        covariance = both @ covariance @ both.T
    return Tracks(tracks.id, move(a, tracks.xy), _turned(a[2], tracks.velocity), tracks.radius, covariance)


def move_decision(a: Pose, decision: Decision) -> Decision:
    """Return a decision of a frame with the pose `a` in the world; the cells of pheromone do not change."""
    path, target = decision.path, decision.local_target
    return replace(
        decision,
        path=None if path is None else TimedPath(path.t, move(a, path.xy)),
        local_target=None if target is None else move_point(a, target),
    )


def level(grid: Grid) -> tuple[Grid, Pose]:
    """Return `grid` in a frame in which its yaw is 0, and the pose of that frame in the map's (a turn about its origin).

    Where the map is too far away for an episode, the frame is at the multiple of 100 km that is nearest to the map's corner, so
    that it seldom moves while the map grows.

    Examples
    --------
    >>> grid, frame = level(Grid(np.zeros((2, 3), bool), 1.0, (4.0, 5.0, math.pi / 2)))
    >>> grid.origin[2], frame[2] == math.pi / 2
    (0.0, True)
    """
    x, y, yaw = grid.origin
    far = max(abs(x), abs(y)) > MAX_ORIGIN
    if yaw == 0.0 and not far:
        return grid, HERE
    at = (round(x, -5), round(y, -5)) if far else (0.0, 0.0)
    return replace(grid, origin=(*turn(-yaw, (x - at[0], y - at[1])), 0.0)), (*at, yaw)
