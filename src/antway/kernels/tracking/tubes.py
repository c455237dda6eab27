"""Predicted tubes of moving obstacles: the first conflict of a timed path with them, and the cells they close."""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Bools, Floats
from antway.kernels.base.geometry import knot_after, swept_timeline, timeline_at
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import Terrain, Trajectories


@bare_kernel
def first_met(
    ax: float, ay: float, bx: float, by: float, start: float, end: float, body: float, wider: float, trajectories: Trajectories
) -> tuple[float, int]:
    """Return the first time at which a body meets a tube, s, and the tube's index; infinity and -1 if it meets none.

    The body moves from (ax, ay) at `start` to (bx, by) at `end` s. Tubes are `wider` m wider than their discs. The other
    parameters are those of `first_conflict`.
    """
    radius = trajectories.radius
    when, obstacle = math.inf, -1
    for k in range(len(radius)):
        contact_radius = body + radius[k] + wider
        hit, _, _ = swept_timeline(ax, ay, bx, by, start, end, contact_radius, trajectories, k)
        if hit < when:
            when, obstacle = hit, k
    return when, obstacle


@bare_kernel
def first_conflict(
    t: Floats, xy: Floats, until: float, body: float, growth: float, trajectories: Trajectories
) -> tuple[float, int]:
    """Return the first time up to `until` s at which a body on a timed path meets a tube, and which; infinity and -1 if none.

    The body, whose radius with its margin is `body` m, is at `xy[i]` m at `t[i]` s, and stands at the path's end. The tubes of
    the predicted discs widen by `growth` m/s after t[0]; each keeps one width for a leg of the path, that at the beginning of
    the leg.
    """
    when, obstacle = math.inf, -1
    n = len(t)
    for i in range(n):
        last = i == n - 1
        start, end = t[i], until if last else min(t[i + 1], until)
        if start > end or start >= when:
            break
        ax, ay = xy[i, 0], xy[i, 1]
        bx, by = ax, ay
        if not last and t[i + 1] > t[i]:
            share = (end - t[i]) / (t[i + 1] - t[i])
            bx, by = ax + share * (xy[i + 1, 0] - ax), ay + share * (xy[i + 1, 1] - ay)
        wider = growth * (start - t[0])
        hit, other = first_met(ax, ay, bx, by, start, end, body, wider, trajectories)
        if hit < when:
            when, obstacle = hit, other
    return when, obstacle


@bare_kernel
def stand_free(
    t: Floats,
    xy: Floats,
    now: float,
    until: float,
    body: float,
    growth: float,
    trajectories: Trajectories,
    free: Bools,
    most: int,
) -> None:
    """Mark in `free`, bool[N], the first `most` places xy[i] at which a body can stand from t[i] to `until` and meets no tube.

    Tubes widen from the time `now` on; the other parameters are those of `first_conflict`.
    """
    free[:] = False
    for i in range(len(t)):
        x, y, wider, met, k = xy[i, 0], xy[i, 1], growth * (t[i] - now), False, 0
        while not met and k < len(trajectories.radius):
            contact_radius = body + trajectories.radius[k] + wider
            hit, _, _ = swept_timeline(x, y, x, y, t[i], max(until, t[i]), contact_radius, trajectories, k)
            met, k = hit < math.inf, k + 1
        free[i] = not met
        most -= int(free[i])
        if most == 0:
            break


@bare_kernel
def close_cells(
    now: float,
    x: float,
    y: float,
    v_max: float,
    early: float,
    late: float,
    horizon: float,
    body: float,
    trajectories: Trajectories,
    terrain: Terrain,
    corner: tuple[int, int],
    closed: Bools,
) -> None:
    """Mark the cells at whose centre a body from (x, y) would meet a tube on arrival.

    A body reaches a cell at distance d between `early` d / v_max and `late` d / v_max + 0.5 s from `now`. With `early` = 0 and
    a large `late`, the whole tube up to `horizon` s from now is closed. `closed`, bool[h, w], is filled; closed[0, 0] is the
    cell `corner`, (row, col), of the map.
    """
    size = terrain.resolution
    left, low = terrain.x0 + corner[1] * size, terrain.y0 + corner[0] * size
    closed[:] = False
    for k in range(len(trajectories.radius)):
        contact_radius = body + trajectories.radius[k]
        # Only cells nearer than that to the box in which the disc moves can meet it; the box is a cell wider, for rounding.
        x0, y0, x1, y1 = _box(now, now + horizon, trajectories, k)
        row0, row1 = (y0 - contact_radius - low) / size, (y1 + contact_radius - low) / size
        col0, col1 = (x0 - contact_radius - left) / size, (x1 + contact_radius - left) / size
        for i in range(max(math.floor(row0) - 1, 0), min(math.ceil(row1) + 1, closed.shape[0])):
            for j in range(max(math.floor(col0) - 1, 0), min(math.ceil(col1) + 1, closed.shape[1])):
                if closed[i, j]:
                    continue
                cx, cy = terrain.x0 + (corner[1] + j + 0.5) * size, terrain.y0 + (corner[0] + i + 0.5) * size
                d = math.hypot(cx - x, cy - y) / v_max
                start, end = now + min(early * d, horizon), now + min(late * d + 0.5, horizon)
                hit, _, _ = swept_timeline(cx, cy, cx, cy, start, end, contact_radius, trajectories, k)
                closed[i, j] = hit < math.inf


@bare_kernel
def _box(start: float, end: float, trajectories: Trajectories, k: int) -> tuple[float, float, float, float]:
    """Return the least and the greatest x and y of the centre of disc k from `start` to `end` s, (x0, y0, x1, y1), m."""
    x0, y0, _, _ = timeline_at(start, trajectories, k)
    x, y, _, _ = timeline_at(end, trajectories, k)
    x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x0, x), max(y0, y)
    for i in range(knot_after(trajectories, k, start), knot_after(trajectories, k, end)):
        x, y = trajectories.knot_xy[i]
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
    return x0, y0, x1, y1
