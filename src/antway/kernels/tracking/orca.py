"""Optimal reciprocal collision avoidance (ORCA): the velocity nearest to the preferred one if each of two avoids by half.

Van den Berg, Guy, Lin, Manocha: Reciprocal n-body collision avoidance, ISRR 2011. A line (x, y, dx, dy) is a point in m/s and a
direction. It allows the velocities on it and to its left.
"""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel

_PARALLEL = 1e-5  # 1; two directions with a smaller cross product count as parallel


@bare_kernel
def half_plane(
    ax: float, ay: float, ux: float, uy: float, contact_radius: float, horizon: float, step: float
) -> tuple[float, float, float, float]:
    """Return the line (x, y, dx, dy) of the velocities that do half of avoiding one other; x and y are relative to the own one.

    The other is at (ax, ay) m from the own place, the own velocity minus that of the other is (ux, uy) m/s, and
    `contact_radius` is the sum of the radii, m. There is to be no contact for `horizon` s, and a contact that exists already is
    to end within `step` s.
    """
    squared = ax * ax + ay * ay
    in_contact = squared <= contact_radius * contact_radius
    span = step if in_contact else horizon
    wx, wy = ux - ax / span, uy - ay / span  # relative to the centre of the disc that cuts off the velocity obstacle
    along = wx * ax + wy * ay
    w = math.hypot(wx, wy)
    if in_contact or (along < 0.0 and along * along > contact_radius * contact_radius * w * w):
        nx, ny = (wx / w, wy / w) if w > 0.0 else (1.0, 0.0)
        shift = 0.5 * (contact_radius / span - w)
        return shift * nx, shift * ny, ny, -nx
    leg = math.sqrt(squared - contact_radius * contact_radius)
    if ax * wy - ay * wx > 0.0:
        dx, dy = (ax * leg - ay * contact_radius) / squared, (ax * contact_radius + ay * leg) / squared
    else:
        dx, dy = -(ax * leg + ay * contact_radius) / squared, (ax * contact_radius - ay * leg) / squared
    on = ux * dx + uy * dy
    return 0.5 * (on * dx - ux), 0.5 * (on * dy - uy), dx, dy


@bare_kernel
def beyond(lines: Floats, i: int, x: float, y: float) -> float:
    """Return how far the velocity (x, y) is on the forbidden side of line i, m/s; it is negative on the allowed side."""
    return float(lines[i, 2] * (lines[i, 1] - y) - lines[i, 3] * (lines[i, 0] - x))


@bare_kernel
def nearest(lines: Floats, n: int, top: float, wx: float, wy: float, far: bool, out: Floats) -> int:
    """Write to `out` the velocity of at most `top` m/s nearest to (wx, wy) that all lines[:n] allow.

    The lines are added one by one (incremental linear programming). With `far` it is the velocity farthest in the direction
    (wx, wy), a vector of length 1. Returns n, or the index of the first line that leaves no velocity; `out` then solves the
    problem of the lines before it.
    """
    scale = top if far else min(1.0, top / max(math.hypot(wx, wy), 1e-12))
    out[0], out[1] = wx * scale, wy * scale
    for i in range(n):
        if beyond(lines, i, out[0], out[1]) <= 0.0:
            continue
        px, py, dx, dy = lines[i, 0], lines[i, 1], lines[i, 2], lines[i, 3]
        foot = px * dx + py * dy
        slack = foot * foot + top * top - px * px - py * py
        if slack < 0.0:
            return i
        low, high = -foot - math.sqrt(slack), -foot + math.sqrt(slack)
        for j in range(i):
            cross = dx * lines[j, 3] - dy * lines[j, 2]
            allowed = lines[j, 2] * (py - lines[j, 1]) - lines[j, 3] * (px - lines[j, 0])  # m/s; (px, py) is so far inside
            if abs(cross) <= _PARALLEL:
                if allowed < 0.0:
                    return i
            elif cross > 0.0:
                high = min(high, allowed / cross)
            else:
                low = max(low, allowed / cross)
        if low > high:
            return i
        t = dx * (wx - px) + dy * (wy - py)
        if far:
            t = high if wx * dx + wy * dy > 0.0 else low
        t = min(max(t, low), high)
        out[0], out[1] = px + t * dx, py + t * dy
    return n


@bare_kernel
def least_violation(lines: Floats, n: int, first: int, top: float, out: Floats, work: Floats) -> None:
    """Write to `out` the velocity whose largest violation of any of lines[:n] is least, where no velocity is allowed.

    On entry `out` is the solution for lines[:first], as `nearest` leaves it.
    """
    worst = 0.0
    for i in range(first, n):
        if beyond(lines, i, out[0], out[1]) <= worst:
            continue
        m = 0
        for j in range(i):  # the line on which lines i and j are violated equally
            cross = lines[i, 2] * lines[j, 3] - lines[i, 3] * lines[j, 2]
            if abs(cross) <= _PARALLEL:
                if lines[i, 2] * lines[j, 2] + lines[i, 3] * lines[j, 3] > 0.0:
                    continue
                work[m, 0], work[m, 1] = 0.5 * (lines[i, 0] + lines[j, 0]), 0.5 * (lines[i, 1] + lines[j, 1])
            else:
                t = -beyond(lines, j, lines[i, 0], lines[i, 1]) / cross
                work[m, 0], work[m, 1] = lines[i, 0] + t * lines[i, 2], lines[i, 1] + t * lines[i, 3]
            dx, dy = lines[j, 2] - lines[i, 2], lines[j, 3] - lines[i, 3]
            length = math.hypot(dx, dy)
            work[m, 2], work[m, 3] = dx / length, dy / length
            m += 1
        x, y = out[0], out[1]
        if nearest(work, m, top, -lines[i, 3], lines[i, 2], True, out) < m:
            out[0], out[1] = x, y
        worst = beyond(lines, i, out[0], out[1])
