"""The shape of a path as a spline, the fastest drive along it, and a search for the shape that is driven fastest.

A path is a uniform cubic B-spline with triple end points: its curvature is continuous and 0 at both ends. Each span has the
same number of samples. The squared speed at each sample is computed by a backward pass (the largest one from which the rest
can be driven: the controllable sets) and a forward pass (the largest one that can be reached: the reachable sets) of Pham and
Pham, TOPP-RA, IEEE T-RO 2018. In the squared speed the limits of speed, acceleration and turning are linear between samples,
and each step has a closed form. The search moves control points at random and keeps a move that lowers the cost: time, and
penalties for missing clearance and for curves that are too tight. A move changes few samples, and both passes stop where they
meet the old values, so a trial takes the same time on paths of any length.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base import rng
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.base.rows import copy_row

_TIGHT = 1e-9  # 1/m; a smaller curvature counts as straight
_SHORT = 1e-9  # m; least distance between two samples
_CLEARANCE_PENALTY = 1000.0  # s/m^2; for missing clearance along the path
_STEERING_PENALTY = 10.0  # s/rad; for turning more tightly than the steering can
_CURVATURE_PENALTY = 0.002  # s m^3; small, for changes of curvature, so that curves are smooth where that takes no time
_CLEARANCE_GROWTH = 0.25  # m/m; growth of the required clearance with the distance from a start or goal that has too little
_LEAST_SPREAD, _MOST_SPREAD = 0.002, 0.5  # m; limits of the standard deviation of a move
_WIDEST = 3  # control points; a move shifts fewer than this many on either side as well
_LEAST_DROP = 1e-9  # s; a move that lowers the cost by less is undone
_MOST_SAMPLES = 100_000_000  # limit of the samples whose speeds moves change: at tiny accelerations each changes most of them
SAMPLES = 8  # samples on a span during the search


class Surroundings(NamedTuple):
    """The map, with its corner at (0, 0), and the body that has to fit into it."""

    border: NDArray[np.bool_]  # [H, W] blocked cells next to free ones
    clearance: NDArray[np.float64]  # [H, W] m; distance of cell centres from blocked cells and map edges
    resolution: float  # m
    need: float  # m; required clearance of each disc
    ends: NDArray[np.float64]  # [2, 3] m; x, y and clearance of start and goal, which may have less than `need`
    discs: NDArray[np.float64]  # [K, 2] m; centres of the discs in the robot's frame
    fixed: bool  # whether the robot keeps the heading 0; else it points along the path


class Curve(NamedTuple):
    """A path of N control points and M = (N + 1) k + 1 samples, and the fastest drive along it."""

    points: NDArray[np.float64]  # [N, 2] m
    xy: NDArray[np.float64]  # [M, 2] m
    tangent: NDArray[np.float64]  # [M, 2] unit vector
    kappa: NDArray[np.float64]  # [M] 1/m; curvature
    ds: NDArray[np.float64]  # [M] m; distance to the next sample
    missing: NDArray[np.float64]  # [M] m; missing clearance
    high: NDArray[np.float64]  # [M] m^2/s^2; largest squared speed from which the rest can be driven
    square: NDArray[np.float64]  # [M] m^2/s^2; squared speed
    cost: NDArray[np.float64]  # [M] s; cost of the step to the next sample


@bare_kernel
def missing_clearance(s: Surroundings, x: float, y: float, need: float) -> float:
    """Return the clearance in m that (x, y) lacks, 0 if none; it is exact except inside walls."""
    rows, cols = s.border.shape
    nearest: float = min(min(x, cols * s.resolution - x), min(y, rows * s.resolution - y))
    if nearest <= 0.0:
        return need - nearest
    i, j = min(int(y / s.resolution), rows - 1), min(int(x / s.resolution), cols - 1)  # a quotient may be rounded up
    off = math.hypot(x - (j + 0.5) * s.resolution, y - (i + 0.5) * s.resolution)
    if s.clearance[i, j] - off >= need:
        return 0.0
    if s.clearance[i, j] == 0.0:
        return need
    near = min(need, nearest)
    best, half = near * near, 0.5 * s.resolution
    for r in range(max(int((y - near) / s.resolution), 0), min(int((y + near) / s.resolution), rows - 1) + 1):
        dy = max(abs(y - (r + 0.5) * s.resolution) - half, 0.0)
        for c in range(max(int((x - near) / s.resolution), 0), min(int((x + near) / s.resolution), cols - 1) + 1):
            if s.border[r, c]:
                dx = max(abs(x - (c + 0.5) * s.resolution) - half, 0.0)
                best = min(best, dx * dx + dy * dy)
    return max(need - math.sqrt(best), 0.0)


@inner_kernel
def _evaluate(curve: Curve, span: int, u: float, at: int) -> None:
    """Compute place, tangent and curvature at the part u, in [0, 1], of a span, as sample `at`."""
    p, n = curve.points, len(curve.points)
    a, d = min(max(span - 2, 0), n - 1), min(span + 1, n - 1)
    b, c = min(max(span - 1, 0), n - 1), min(span, n - 1)
    straight = span == 0 or span == n  # three of its control points coincide
    w = 1.0 - u
    for axis in range(2):
        far, near = w * w * w * p[a, axis] + u * u * u * p[d, axis], u * w
        curve.xy[at, axis] = (
            far + (1.0 + 3.0 * w * (1.0 + near)) * p[b, axis] + (1.0 + 3.0 * u * (1.0 + near)) * p[c, axis]
        ) / 6.0
    tx, ty = p[d, 0] - p[a, 0], p[d, 1] - p[a, 1]
    if not straight:
        tx = 0.5 * (u * u * (p[d, 0] - p[c, 0]) + w * w * (p[b, 0] - p[a, 0])) + (0.5 + u * w) * (p[c, 0] - p[b, 0])
        ty = 0.5 * (u * u * (p[d, 1] - p[c, 1]) + w * w * (p[b, 1] - p[a, 1])) + (0.5 + u * w) * (p[c, 1] - p[b, 1])
    size = max(math.hypot(tx, ty), _SHORT)
    cos, sin = tx / size, ty / size
    curve.tangent[at, 0], curve.tangent[at, 1], curve.kappa[at] = cos, sin, 0.0
    if not straight:
        bx = w * (p[a, 0] - 2.0 * p[b, 0] + p[c, 0]) + u * (p[b, 0] - 2.0 * p[c, 0] + p[d, 0])
        by = w * (p[a, 1] - 2.0 * p[b, 1] + p[c, 1]) + u * (p[b, 1] - 2.0 * p[c, 1] + p[d, 1])
        curve.kappa[at] = (cos * by - sin * bx) / (size * size)


@inner_kernel
def _missing_at(curve: Curve, s: Surroundings, at: int) -> float:
    """Return the largest clearance in m that one of the robot's discs lacks at sample `at`."""
    x0, y0 = curve.xy[at, 0], curve.xy[at, 1]
    cos, sin = (1.0, 0.0) if s.fixed else (curve.tangent[at, 0], curve.tangent[at, 1])
    most, need = 0.0, s.need
    for i in range(2):
        need = min(need, s.ends[i, 2] + _CLEARANCE_GROWTH * math.hypot(x0 - s.ends[i, 0], y0 - s.ends[i, 1]))
    for i in range(len(s.discs)):
        x = x0 + cos * s.discs[i, 0] - sin * s.discs[i, 1]
        y = y0 + sin * s.discs[i, 0] + cos * s.discs[i, 1]
        most = max(most, missing_clearance(s, x, y, need))
    return most


@bare_kernel
def sample(curve: Curve, s: Surroundings, first: int, last: int) -> None:
    """Compute the samples on the spans `first` to `last`, and the steps between them."""
    n = len(curve.points)
    k = (len(curve.xy) - 1) // (n + 1)
    for span in range(first, last + 1):
        for part in range(k + 1 if span == n else k):
            at = span * k + part
            _evaluate(curve, span, part / k, at)
            curve.missing[at] = _missing_at(curve, s, at)
    for at in range(max(first * k - 1, 0), min((last + 1) * k, len(curve.xy) - 1)):
        step = math.hypot(curve.xy[at + 1, 0] - curve.xy[at, 0], curve.xy[at + 1, 1] - curve.xy[at, 1])
        curve.ds[at] = max(step, _SHORT)


@inner_kernel
def _controllable(curve: Curve, limits: RobotLimits, i: int) -> float:
    """Return the largest squared speed at sample i from which the limits allow one that is permitted at sample i + 1."""
    k0, k1, ds, after = curve.kappa[i], curve.kappa[i + 1], curve.ds[i], curve.high[i + 1]
    middle = 0.5 * (k0 + k1)
    most: float = limits.v_max * limits.v_max
    if limits.drive == HOLONOMIC:
        across = min(limits.a_max, limits.brake_max)
        most = min(most, across / max(max(abs(middle), abs(k0)), _TIGHT))
        drop, k = 2.0 * ds * limits.brake_max, abs(middle) / across
        under = 1.0 + k * k * (drop * drop - after * after)
        if k * after < 1.0 and under > 0.0:
            most = min(most, (after + drop * math.sqrt(under)) / (1.0 + drop * drop * k * k))
        return most
    most = min(most, (limits.turn_rate / max(abs(k0), _TIGHT)) ** 2, after + 2.0 * ds * limits.brake_max)
    change = (k1 - k0) / ds
    if abs(middle) < _TIGHT:
        straight: float = min(most, limits.alpha_max / max(abs(change), _TIGHT))
        return straight
    spare, ratio = limits.alpha_max / abs(middle), change / middle
    if 2.0 * ds * ratio < 1.0:
        most = min(most, (after + 2.0 * ds * spare) / (1.0 - 2.0 * ds * ratio))
    elif 2.0 * ds * ratio > 1.0:
        most = min(most, 2.0 * ds * spare / (2.0 * ds * ratio - 1.0))
    if ratio < 0.0:
        most = min(most, (limits.a_max + spare) / -ratio)
    elif ratio > 0.0:
        most = min(most, (limits.brake_max + spare) / ratio)
    return most


@inner_kernel
def _reachable(curve: Curve, limits: RobotLimits, i: int) -> float:
    """Return the largest squared speed at sample i + 1, given that at sample i."""
    square, middle, ds = curve.square[i], 0.5 * (curve.kappa[i] + curve.kappa[i + 1]), curve.ds[i]
    rate = limits.a_max
    if limits.drive == HOLONOMIC:
        part = abs(middle) * square / min(limits.a_max, limits.brake_max)
        rate *= math.sqrt(max(1.0 - part * part, 0.0))
    elif abs(middle) >= _TIGHT:
        change = (curve.kappa[i + 1] - curve.kappa[i]) / ds
        rate = min(rate, limits.alpha_max / abs(middle) - change / middle * square)
    after: float = max(min(square + 2.0 * ds * rate, curve.high[i + 1]), 0.0)
    return after


@bare_kernel
def drive_along(curve: Curve, limits: RobotLimits, first: int, last: int, old: Curve) -> tuple[int, int, int]:
    """Recompute speeds and costs after the steps `first` to `last` have changed; save the previous ones in `old`.

    Returns (low, start, end): `high` has changed from low to last, `square` and `cost` from start to end.
    """
    m, tightest = len(curve.xy), math.inf
    if limits.turning_radius > 0.0:
        tightest = 1.0 / limits.turning_radius
    low = last
    for i in range(last, -1, -1):
        most = _controllable(curve, limits, i)
        if i < first and most == curve.high[i]:
            break
        low = i
        old.high[i], curve.high[i] = curve.high[i], most
    start = max(min(low, first) - 1, 0)
    end = start
    for i in range(start, m):
        square = 0.0 if i == 0 else _reachable(curve, limits, i - 1)
        old.square[i], old.cost[i] = curve.square[i], curve.cost[i]
        if i > last + 1 and square == curve.square[i]:
            break
        end, curve.square[i] = i, square
    for i in range(start, min(end + 1, m - 1)):
        ds = curve.ds[i]
        time = 2.0 * ds / max(math.sqrt(curve.square[i]) + math.sqrt(curve.square[i + 1]), 1e-12)
        bent = max(abs(curve.kappa[i]) - tightest, 0.0) + max(abs(curve.kappa[i + 1]) - tightest, 0.0)
        turn = (curve.kappa[i + 1] - curve.kappa[i]) ** 2 / ds
        price = 0.5 * _CLEARANCE_PENALTY * (curve.missing[i] + curve.missing[i + 1]) + 0.5 * _STEERING_PENALTY * bent
        curve.cost[i] = time + price * ds + _CURVATURE_PENALTY * turn
    return low, start, end


@bare_kernel
def _copy_samples(source: Curve, target: Curve, first: int, last: int) -> None:
    """Copy the samples `first` to `last`, and the steps before and after them."""
    for i in range(max(first - 1, 0), last + 1):
        target.xy[i, 0], target.xy[i, 1] = source.xy[i, 0], source.xy[i, 1]
        target.tangent[i, 0], target.tangent[i, 1] = source.tangent[i, 0], source.tangent[i, 1]
        target.kappa[i], target.ds[i], target.missing[i] = source.kappa[i], source.ds[i], source.missing[i]


@kernel
def improve(curve: Curve, old: Curve, s: Surroundings, limits: RobotLimits, trials: int, state: NDArray[np.uint64]) -> float:
    """Move control points of `curve` at random, `trials` times each, and keep moves that lower its cost; return the cost in s.

    It ends before that once `_MOST_SAMPLES` speeds have been computed, which takes seconds.
    `old` is scratch of the same shape, `state`, uint64[1], that of the random generator.
    """
    n, m = len(curve.points), len(curve.xy)
    sample(curve, s, 0, n)
    curve.high[m - 1] = curve.square[0] = curve.cost[m - 1] = 0.0
    drive_along(curve, limits, 0, m - 2, old)
    spread = np.full(n, 0.1)
    total: float = curve.cost.sum()
    computed = 0
    for _ in range(trials * (n - 2)):
        i, width = 1 + rng.below(state, n - 2), 1 + rng.below(state, _WIDEST)
        r = spread[i] * math.sqrt(-2.0 * math.log(1.0 - rng.uniform(state)))
        angle = 2.0 * math.pi * rng.uniform(state)
        change, samples = _try_move(curve, old, s, limits, i, width, r * math.cos(angle), r * math.sin(angle))
        if change < 0.0:
            total += change
            spread[i] = min(spread[i] * 1.6, _MOST_SPREAD)
        else:
            spread[i] = max(spread[i] * 0.93, _LEAST_SPREAD)
        computed += samples
        if computed > _MOST_SAMPLES:
            break
    return total


@bare_kernel
def _try_move(
    curve: Curve, old: Curve, s: Surroundings, limits: RobotLimits, i: int, width: int, dx: float, dy: float
) -> tuple[float, int]:
    """Move control point i by (dx, dy) m and its neighbours by less.

    Returns by how much that changes the cost, s, and the number of speeds computed. A move that does not lower the cost is
    undone, and the change is 0.
    """
    n, m = len(curve.points), len(curve.xy)
    k = (m - 1) // (n + 1)
    low, high = max(i - width + 1, 1), min(i + width - 1, n - 2)
    first, last = max(low - 1, 0), min(high + 2, n)
    a, b = first * k, min((last + 1) * k, m - 1)
    for j in range(low, high + 1):
        copy_row(curve.points[j], old.points[j])
        part = 1.0 - abs(j - i) / width
        curve.points[j, 0] += part * dx
        curve.points[j, 1] += part * dy
    _copy_samples(curve, old, a, b)
    sample(curve, s, first, last)
    lowest, start, end = drive_along(curve, limits, max(a - 1, 0), b - 1, old)
    change = 0.0
    for j in range(start, end + 1):
        change += curve.cost[j] - old.cost[j]
    if change < -_LEAST_DROP:
        return change, b - lowest + end - start
    for j in range(low, high + 1):
        copy_row(old.points[j], curve.points[j])
    _copy_samples(old, curve, a, b)
    copy_row(old.high[lowest:b], curve.high[lowest:b])
    copy_row(old.square[start : end + 1], curve.square[start : end + 1])
    copy_row(old.cost[start : end + 1], curve.cost[start : end + 1])
    return 0.0, b - lowest + end - start
