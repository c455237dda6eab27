"""Tracks from laser scans: points off the map, clustered into discs and followed by Kalman filters; no ROS import."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Grid
from antway.kernels.tracking import kalman
from antway.kernels.tracking.noise import COLUMNS, STATE, measured_noise
from antway.kernels.tracking.predict import ID, RADIUS, SIGMA, SIGMA_V, VX, VY, X, Y
from antway.kernels.tracking.table import make_table, rows_in_use
from antway.limits import MAX_ANGLE, MAX_PLACE
from antway.policies.antway.tracker import AGILITY, MOST_ROWS, ids_of, nearest, with_ids
from antway.ros2.frames import Pose, move
from antway.world.policy import XY, Tracks

_ROUND = 0.03  # m; tolerance for points on a circle
_TURNED = 0.02  # rad; error of the robot's heading on the map, by which far walls are elsewhere
_NOISE = 0.05  # m; standard deviation of the places of tracks
_FITTED = 0.02  # m; the same for discs whose rim a laser sees
_HIDDEN = 2.0  # 1; the centre of a disc that is hidden in part is uncertain by the change of its radius times this
_SCANS = 3  # number of scans in which a disc has shown its rim before it counts as one
FIRST_ID = 10**15  # the node's own ids are counted from here on: far from those of sensors, and below those of the policy
_LEG = 0.12  # m; people's legs are no wider, and do not count as discs
_WAITING = 200  # number of scans that may wait for odometry, which may be late by as much as `timeout` even with fast lasers


class Discs(NamedTuple):
    """Discs that a laser sees."""

    xy: NDArray[np.float64]  # float64[N, 2], m; centres
    radius: NDArray[np.float64]  # float64[N], m
    is_circle: NDArray[np.bool_]  # bool[N]; whether the points lie on the disc's rim
    points: list[NDArray[np.float64]]  # of each disc, float64[M, 2], m


def read_points(message: Any, valid: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the points of a sensor_msgs/msg/LaserScan, float64[N, 2] in m in the laser's frame, and which beams they are.

    A range of -inf (too near to measure, REP 117) counts as range_min; NaN, 0 and ranges out of limits give no point, nor does
    range_max itself, which some drivers and simulators report where nothing is in range. range_max may be infinite. The share
    `valid` of the beams, [0, 1], must be valid, which NaN, 0 and ranges below range_min, -inf too, are not: a covered or broken
    laser does not mean that the place is empty.

    Raises
    ------
    BadParameter
        For numbers that are not finite or beyond limits (docs/limits.md), a step of 0, range_min above range_max, an empty
        scan, or too few valid beams.
    """
    where = "LaserScan"
    start, step = (
        checks.number(n, getattr(message, n), low=-MAX_ANGLE, high=MAX_ANGLE, unit="rad", where=where)
        for n in ("angle_min", "angle_increment")
    )
    limits = message.range_min, min(message.range_max, MAX_PLACE)  # pointcloud_to_laserscan leaves range_max infinite
    near, far = (
        checks.number(n, value, low=-MAX_PLACE, high=MAX_PLACE, unit="m", where=where)
        for n, value in zip(("range_min", "range_max"), limits, strict=True)
    )
    r = np.asarray(message.ranges, np.float64)
    if step == 0.0:
        raise BadParameter("angle_increment", step, "not 0", where=where)
    if r.ndim != 1 or len(r) == 0:
        raise BadParameter("ranges.shape", r.shape, "(N,) with N > 0", where=where)
    if not 0.0 <= near <= far:
        raise BadParameter("range_min, range_max", (near, far), "0 <= range_min <= range_max (m)", where=where)
    r = np.where(r == 0.0, math.nan, r)  # so drivers mark beams without a return
    sound = float((r >= near).mean())  # a laser that says everywhere that all is too near is covered
    if sound < valid:
        raise BadParameter("ranges", f"{100 * sound:.0f} % valid", f"valid in at least {100 * valid:g} % of beams", where=where)
    r = np.where(r == -math.inf, near, r)
    hit = (r >= near) & (r < far)  # not where NaN
    beams = np.flatnonzero(hit)
    r, angle = r[hit], start + step * beams
    return np.column_stack((r * np.cos(angle), r * np.sin(angle))), beams


def newest_reached(waiting: deque[tuple[float, Any]], t: float) -> tuple[float, Any] | None:
    """Take the scans that odometry, now at `t` s, has reached out of those waiting, (stamp in s, message); return the newest.

    Examples
    --------
    >>> waiting = deque([(1.0, "a"), (1.1, "b"), (1.2, "c")])
    >>> newest_reached(waiting, 1.15), waiting
    ((1.1, 'b'), deque([(1.2, 'c')]))
    """
    reached, later = [one for one in waiting if one[0] <= t], [one for one in waiting if one[0] > t]
    waiting.clear()
    waiting.extend(later)
    return max(reached, key=lambda one: one[0], default=None)


class Laser:
    """Scans of a laser, each of which waits for odometry, which tells where the robot was at each of its beams.

    No sweep from the first beam to the last is believed to be longer than `longest` s: some drivers report nonsense.
    """

    def __init__(self, longest: float) -> None:
        self.longest = longest
        self.waiting: deque[tuple[float, Any]] = deque(maxlen=_WAITING)  # scans, with the times of their last beams in s
        self.trail: deque[tuple[float, Pose]] = deque()  # where the robot was, with times in s

    def _sweep(self, message: Any) -> float:
        """Return the time from the first beam to the last, s; 0 if that is not said, or cannot be."""
        took = (len(message.ranges) - 1) * getattr(message, "time_increment", 0.0)
        return took if 0.0 <= took <= self.longest else 0.0

    def receive(self, stamp: float, message: Any) -> None:
        """Keep a scan whose first beam was measured at `stamp` s."""
        self.waiting.append((stamp + self._sweep(message), message))

    def drop_newer(self, t: float, most: float) -> float:
        """If all scans that wait are newer than `t` s by more than `most` s, drop them and return by how much, s; else 0."""
        ahead = min((one[0] for one in self.waiting), default=t) - t
        if ahead <= most:
            return 0.0
        self.waiting.clear()
        return ahead

    @property
    def newest(self) -> float:
        """The time of the newest odometry, s; -inf before the first."""
        return self.trail[-1][0] if self.trail else -math.inf

    def moved(self, t: float, pose: Pose) -> None:
        """Receive where the robot is at `t` s; where it was long ago is forgotten. If time goes back, all is."""
        if t < self.newest:
            self.trail.clear()
            self.waiting.clear()
        self.trail.append((t, pose))
        while self.trail[0][0] < t - 4.0 * self.longest:
            self.trail.popleft()

    def middle(self, scan: tuple[float, Any]) -> float:
        """Return the time of the middle of a scan that waited, s."""
        return scan[0] - self._sweep(scan[1]) / 2

    def placed(self, scan: tuple[float, Any], mount: Pose, upside_down: bool, valid: float) -> NDArray[np.float64]:
        """Return the points of a scan by a laser that is mounted at `mount` on the robot, float64[N, 2] in m in the world.

        Each is placed by where the robot was when it was measured. `valid` is as in `read_points`.
        """
        end, message = scan
        points, beams = read_points(message, valid)
        if upside_down:
            points[:, 1] *= -1.0
        when = end - self._sweep(message) * (1.0 - beams / max(len(message.ranges) - 1, 1))
        t, poses = np.array([one[0] for one in self.trail]), np.array([one[1] for one in self.trail])
        x, y, yaw = (np.interp(when, t, values) for values in (*poses.T[:2], np.unwrap(poses[:, 2])))
        cos, sin, (px, py) = np.cos(yaw), np.sin(yaw), move(mount, points).T
        return np.column_stack((x + cos * px - sin * py, y + sin * px + cos * py))


class Background:
    """Tells which points are part of a map: a blocked cell, or the map's edge, is within `clear` m along either axis.

    For each metre from the laser it may be 2 cm farther, because the robot's heading on the map is never exact.
    """

    def __init__(self, grid: Grid, clear: float) -> None:
        self.grid, self.clear = grid, clear
        rows, cols = grid.shape
        self.before = np.zeros((rows + 1, cols + 1), np.int32)  # numbers of blocked cells in lower rows and columns
        np.cumsum(grid.blocked, axis=0, out=self.before[1:, 1:])
        np.cumsum(self.before, axis=1, out=self.before)

    def off(self, xy: NDArray[np.float64], laser: XY) -> NDArray[np.float64]:
        """Return those of the points `xy`, float64[N, 2] in m, seen from `laser`, that are not part of the map."""
        at, away = self.grid.to_points(xy) + 0.5, np.hypot(*(xy - laser).T)[:, None]
        near = (self.clear + _TURNED * away) / self.grid.resolution
        low, high = (np.floor(at + side).astype(np.int64) for side in (-near, near))
        inside = ((low >= 0) & (high < self.grid.shape)).all(axis=1)
        (y0, x0), (y1, x1), before = low[inside].T, high[inside].T + 1, self.before
        blocked = before[y1, x1] - before[y0, x1] - before[y1, x0] + before[y0, x0]
        free: NDArray[np.float64] = xy[inside][blocked == 0]
        return free


def discs(xy: NDArray[np.float64], *, gap: float, largest: float) -> Discs:
    """Cluster points, float64[N, 2] in m in the order of beams, at gaps of more than `gap` m, and return discs.

    A cluster on a circle becomes that disc. Any other becomes the disc around the midpoint of its ends that contains it (a
    laser sees the near side of an object, whose ends are as far apart as the object is wide), enlarged by half the spacing of
    its points. Clusters that do not fit into a disc of radius `largest` m are halved. Single points are noise.
    """
    if len(xy) == 0:
        return Discs(np.empty((0, 2)), np.empty(0), np.empty(0, bool), [])
    breaks = np.flatnonzero(np.hypot(*np.diff(xy, axis=0).T) > gap) + 1
    clusters = np.split(xy, breaks)
    if len(clusters) > 1 and math.dist(xy[0], xy[-1]) <= gap:  # the scan covers the full circle
        clusters[0] = np.vstack((clusters.pop(), clusters[0]))
    found, points = [], []
    while clusters:
        cluster = clusters.pop()
        if len(cluster) < 2:
            continue
        middle = (cluster[0] + cluster[-1]) / 2
        extent = float(np.hypot(*(cluster - middle).T).max())
        if extent > largest and len(cluster) > 3:
            clusters += [cluster[: len(cluster) // 2 + 1], cluster[len(cluster) // 2 :]]
            continue
        spacing = float(np.median(np.hypot(*np.diff(cluster, axis=0).T)))
        circle = _circle(cluster, largest)
        found.append((*(circle or (middle[0], middle[1], extent + spacing / 2)), circle is not None))
        points.append(cluster)
    rows = np.array(found[::-1], np.float64).reshape(-1, 4)
    return Discs(rows[:, :2].copy(), rows[:, 2].copy(), rows[:, 3] > 0.0, points[::-1])


def _circle(cluster: NDArray[np.float64], largest: float) -> tuple[float, float, float] | None:
    """Return x, y and radius of the circle through the points, or None if they are not on an arc of at least a quarter.

    The circle is the least squares solution of x^2 + y^2 = 2 a x + 2 b y + c (Kasa: A curve fitting procedure, 1976).
    """
    if len(cluster) < 5:
        return None
    offset = cluster.mean(axis=0)
    p = cluster - offset
    (a, b, c), *_ = np.linalg.lstsq(np.column_stack((2.0 * p, np.ones(len(p)))), (p**2).sum(axis=1), rcond=None)
    radius = math.sqrt(max(c + a * a + b * b, 0.0))  # rounding makes it negative where all points are at one place
    error = np.abs(np.hypot(p[:, 0] - a, p[:, 1] - b) - radius).max()
    chord = math.dist(p[0], p[-1])
    if radius > largest or error > _ROUND or chord < math.sqrt(2.0) * radius:
        return None
    return float(a + offset[0]), float(b + offset[1]), radius


class ScanTracker:
    """Adds missing ids and velocities to tracks, by a Kalman filter for each (kernels/tracking/kalman.py)."""

    def __init__(self) -> None:
        self.table, self.estimates = make_table(MOST_ROWS, kalman.COLUMNS, ID), np.zeros((MOST_ROWS, 8))
        self.next_id, self.t = FIRST_ID, -math.inf
        self.measured, self.shown = make_table(MOST_ROWS, COLUMNS), np.zeros(STATE)  # for kernels/tracking/noise.py
        # Of each track that a laser sees: its radius in m, and in how many scans it was on a circle of that radius.
        self.radius: dict[int, tuple[float, int]] = {}

    def update(self, t: float, seen: Tracks, xy: XY = (0.0, 0.0), places: Discs | None = None) -> Tracks:
        """Update with the tracks seen at `t` s; return all tracks that should be there at `t`. If time goes back, restart.

        A track that was seen once is returned that once: the policy, which knows the map, decides whether something hides it.
        Of too many, those nearest to the robot at `xy` m are followed. Complete tracks are returned unchanged. Tracks without
        an id (-1, or one that occurs twice) get one. `places` are the discs that a laser sees, if `seen` are those.
        """
        seen = seen.distinct()
        if len(seen) and seen.id.min() >= 0 and not np.isnan(seen.velocity).any():
            return seen
        if len(seen) > MOST_ROWS:
            seen, places = nearest(seen, xy), None
        if t < self.t:
            self.table.used[0] = self.measured.used[0] = 0
        self.t = t
        seen, self.next_id = with_ids(seen, t, self.table, self.next_id)
        noise = np.full(len(seen), _NOISE)
        if places is not None:
            seen, noise = self._centred(seen, t, places)
        scan = seen.id, seen.xy, seen.velocity, seen.radius, self._variances(seen, t, noise)
        rows, used, _ = self.table
        known, _, _ = kalman.update(rows, used, t, *scan, AGILITY, self.estimates)
        table, estimate = rows[:known], self.estimates[:known]
        if self.radius:  # nothing but a laser shows rims
            self.radius = {one: self.radius[one] for one in ids_of(table).tolist() if one in self.radius}
            now = dict(zip(seen.id.tolist(), seen.radius.tolist(), strict=True))
            for row in estimate:
                radius, scans = self.radius.get(int(row[ID]), (0.0, 0))
                if scans >= _SCANS:
                    row[RADIUS] = max(radius, now.get(int(row[ID]), 0.0))
        there = (table[:, kalman.T] == t) | (table[:, kalman.SCANS] > 1.0)
        table, estimate = table[there], estimate[there]
        covariance = np.zeros((len(table), 4, 4))
        age = t - table[:, kalman.T]
        for place, speed in ((0, 2), (1, 3)):
            covariance[:, place, place] = estimate[:, SIGMA] ** 2
            covariance[:, speed, speed] = estimate[:, SIGMA_V] ** 2
            covariance[:, place, speed] = covariance[:, speed, place] = table[:, kalman.P12] + age * table[:, kalman.P22]
        return Tracks(ids_of(estimate), estimate[:, :2].copy(), estimate[:, 2:4].copy(), estimate[:, RADIUS].copy(), covariance)

    def _variances(self, seen: Tracks, t: float, noise: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the variances of places (m^2) and velocities (m^2/s^2), float64[N, 2]: those stated, if any are.

        Else `noise` are the standard deviations of places, and innovations show how wrong velocities are.
        """
        if seen.covariance is not None:
            return np.column_stack((seen.variances(0), seen.variances(2)))
        shown = 0.0
        if not np.isnan(seen.velocity).all():
            shown = measured_noise(*self.measured[:2], self.shown, t, seen.id, seen.xy, seen.velocity)[1]
        return np.column_stack((noise**2, np.full(len(seen), shown)))

    def _centred(self, seen: Tracks, t: float, places: Discs) -> tuple[Tracks, NDArray[np.float64]]:
        """Return what a laser sees with better centres, and their standard deviations, m.

        The centre of a circle is known; if its track was none before, it was hidden in part, and was elsewhere all the time.
        What was a circle and is none now may lie on one of the same radius still. Else it is hidden, or joined to another, and
        its centre is elsewhere by about as much as its radius is another one. Of all others, such as legs, the middle counts.
        """
        xy, radius, noise = seen.xy.copy(), seen.radius.copy(), np.full(len(seen), _NOISE)
        rows = {int(row[ID]): row for row in rows_in_use(self.table)}
        for k, one in enumerate(seen.id.tolist()):
            row = rows.get(one)
            before, scans = self.radius.get(one, (0.0, 0)) if row is not None else (0.0, 0)
            change = float(radius[k]) - before
            if places.is_circle[k] and radius[k] >= _LEG:
                noise[k] = _FITTED
                self.radius[one] = float(radius[k]), min(scans + 1, 3 * _SCANS)
                if row is not None and scans == 0:  # it was hidden in part, and its centre elsewhere
                    row[[X, Y]] = xy[k] - row[[VX, VY]] * (t - row[kalman.T])
            elif row is not None and scans > 0:
                found = _of_radius(places.points[k], before, row[[X, Y]] + row[[VX, VY]] * (t - row[kalman.T]))
                noise[k] = math.hypot(_NOISE, _HIDDEN * change) if found is None else _FITTED
                self.radius[one] = before, scans - (found is None)
                xy[k], radius[k] = (xy[k], radius[k]) if found is None else (found, before)
            else:
                self.radius[one] = float(radius[k]), 0
        return replace(seen, xy=xy, radius=radius), noise


def _of_radius(points: NDArray[np.float64], radius: float, near: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the centre near `near` of the circle of this radius through points, float64[N, 2]; None if there is none.

    It minimises the sum of squared distances from the rim by Gauss and Newton's method.
    """
    if len(points) < 3:
        return None
    centre = near
    for _ in range(5):
        away = points - centre
        distance = np.hypot(*away.T)
        if distance.min() < 1e-6:
            return None
        error = distance - radius
        centre = centre + np.linalg.lstsq(away / distance[:, None], error, rcond=None)[0]
    error = np.hypot(*(points - centre).T) - radius
    return centre if np.abs(error).max() <= _ROUND and math.dist(centre, near) <= radius else None


def without_ids(xy: NDArray[np.float64], radius: NDArray[np.float64]) -> Tracks:
    """Return discs as tracks without ids and velocities."""
    return Tracks(np.full(len(xy), -1, np.int64), xy, np.full((len(xy), 2), math.nan), radius)
