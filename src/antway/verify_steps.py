"""The part of `check_episode` about robots that drive straight at constant speed in each control cycle."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from antway.verify import inside_box
from antway.verify_motion import REST, angle, not_along

if TYPE_CHECKING:
    from antway.world.trace import Trace

_NEAR = 1e-6  # m, m/s, rad; tolerance of the rules


def step_faults(trace: Trace) -> Iterator[str]:
    """Yield where the trace does not follow limits and commands, and where the robot passes through something."""
    xy, v, dt = trace.xy, trace.velocity, np.diff(trace.t)
    if (np.abs(np.diff(xy, axis=0) - v[1:] * dt[:, None]) > _NEAR).any():
        yield "a place is not where its velocity leads"
    yield from _command_faults(trace)
    gap = step_gaps(trace)
    for k in np.flatnonzero(gap.min(axis=0) < -_NEAR).tolist() if gap.size else []:
        yield f"passes through obstacle {trace.timeline.id[k]} in step {int(np.argmin(gap[:, k]))}"
    depth = [wall_gap(trace, i) for i in range(len(dt))]
    if depth and min(depth) < -_NEAR:
        yield f"passes through a wall in step {depth.index(min(depth))}"


def _command_faults(trace: Trace) -> Iterator[str]:
    """Yield where a velocity or a heading is not what the command before leads to within the robot's limits."""
    spec, v, heading = trace.task.robot, trace.velocity, trace.heading
    asked = np.where(np.isfinite(trace.command).all(axis=1, keepdims=True), trace.command, 0.0)
    size = np.hypot(*asked.T)
    asked = asked * (spec.v_max / np.maximum(size, spec.v_max))[:, None]
    gain = spec.a_max * spec.dt
    if spec.drive == "differential":
        turn, most = np.abs(angle(np.arctan2(asked[:, 1], asked[:, 0]) - heading[:-1])), spec.turn_rate * spec.dt
        left = np.abs(angle(np.arctan2(asked[:, 1], asked[:, 0]) - heading[1:])) - np.maximum(turn - most, 0.0)
        turned = np.abs(angle(np.diff(heading))) - np.where(size > REST, np.minimum(turn, most), 0.0)
        wrong = (turned > _NEAR) | ((size > REST) & (np.abs(left) > _NEAR))
        ahead = np.column_stack((np.cos(heading), np.sin(heading)))
        speed = (v * ahead).sum(axis=1)[:-1]
        wanted = np.maximum((asked * ahead[1:]).sum(axis=1), 0.0)
        led = np.clip(wanted, speed - gain, speed + gain)[:, None] * ahead[1:]
    else:
        wrong = not_along(trace)
        change = asked - v[:-1]
        far = np.hypot(*change.T)
        led = v[:-1] + change * np.where(far > gain, gain / np.where(far > 0.0, far, 1.0), 1.0)[:, None]
    if wrong.any():
        yield "a heading is not where its command turns it"
    if (np.abs(led - v[1:]) > _NEAR).any():
        yield "a velocity is not what its command leads to"


def step_gaps(trace: Trace) -> NDArray[np.float64]:
    """Return the smallest gap of robot and obstacle in each step, float64[N, K], m; between knots both move straight."""
    line, t = trace.timeline, trace.t
    gap = np.empty((len(t) - 1, len(line)))
    for k, (low, high) in enumerate(pairwise(line.first.tolist())):
        knots, places = line.knot_t[low:high], line.knot_xy[low:high]
        every = np.union1d(t, knots[(knots > t[0]) & (knots < t[-1])])
        apart = np.column_stack([np.interp(every, t, trace.xy[:, a]) - np.interp(every, knots, places[:, a]) for a in (0, 1)])
        step = np.diff(apart, axis=0)
        square = (step**2).sum(axis=1)
        share = np.clip(-(apart[:-1] * step).sum(axis=1) / np.where(square > 0, square, 1.0), 0.0, 1.0)
        near = np.hypot(*(apart[:-1] + share[:, None] * step).T)
        np.minimum.reduceat(near, np.searchsorted(every, t[:-1]), out=gap[:, k])
        gap[:, k] -= line.radius[k] + trace.task.robot.radius
    return gap


def wall_gap(trace: Trace, i: int) -> float:
    """Return the smallest gap of the robot and nearby blocked squares or map edges in step i, m."""
    grid, radius = trace.task.grid, trace.task.robot.radius / trace.task.grid.resolution
    rows, cols = grid.shape
    a, b = grid.to_points(trace.xy[i : i + 2]).tolist()
    least = min(min(p[0] + 0.5, rows - 0.5 - p[0], p[1] + 0.5, cols - 0.5 - p[1]) for p in (a, b))
    low = [math.floor(min(a[k], b[k]) - radius - 1) for k in (0, 1)]
    high = [math.ceil(max(a[k], b[k]) + radius + 1) for k in (0, 1)]
    near = grid.blocked[max(low[0], 0) : max(high[0] + 1, 0), max(low[1], 0) : max(high[1] + 1, 0)]
    for r, c in np.argwhere(near).tolist():
        least = min(least, _square_distance(a, b, r + max(low[0], 0), c + max(low[1], 0)))
    return float((least - radius) * grid.resolution)


def _square_distance(a: Sequence[float], b: Sequence[float], r: int, c: int) -> float:
    """Return the distance of the segment from the closed square of cell (r, c), in cells."""
    first, last = inside_box(a, b, (r - 0.5, c - 0.5), (r + 0.5, c + 0.5))
    if first <= last:
        return 0.0
    ends = (math.hypot(max(abs(p[0] - r) - 0.5, 0.0), max(abs(p[1] - c) - 0.5, 0.0)) for p in (a, b))
    d = (b[0] - a[0], b[1] - a[1])
    square = d[0] * d[0] + d[1] * d[1]
    corners = []
    for p in ((r + i, c + j) for i in (-0.5, 0.5) for j in (-0.5, 0.5)):
        share = min(max(((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / square, 0.0), 1.0) if square else 0.0
        corners.append(math.dist(p, (a[0] + share * d[0], a[1] + share * d[1])))
    return min(*ends, *corners)
