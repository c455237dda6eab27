"""Drives episodes of robots with wheels, inertia, latency and footprints again, in small steps with independent code."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from antway.world.robots import RobotSpec
    from antway.world.trace import Trace

REST = 1e-9  # m/s, rad/s; slower robots and commands are at rest, and keep their heading
_NEAR = 1e-6  # m, m/s, rad; tolerance of the rules
_SLACK = 1e-5  # m; tolerance of gaps, and depth of a contact that may go unseen between samples
CLOSE = 1e-4  # m; tolerance of the smallest distance of an episode, which is computed from samples
EVEN = 1e-9  # m^2/s^2; a ramp at nearly a right angle to the command counts as braking
_STEPS = 100, 2000  # least and largest number of steps in each part of a cycle: before and after the delayed command acts

Floats = NDArray[np.float64]
State = tuple[Floats, Floats, Floats, Floats, Floats]  # x, y (m), heading (rad), and (v, omega) of wheels or else (vx, vy)


def array_faults(record: object, shapes: Mapping[str, tuple[int, ...]], finite: Iterable[str]) -> list[str]:
    """Return which parts of a record are no arrays of numbers, have not the shape of their name, or are not `finite`."""
    arrays = {name: getattr(record, name) for name in shapes}
    faults = [
        f"{name} is no array of numbers"
        for name, a in arrays.items()
        if not (isinstance(a, np.ndarray) and a.dtype.kind in "biuf")
    ]
    faults = faults or [
        f"{name} has the shape {a.shape} in place of {shapes[name]}" for name, a in arrays.items() if a.shape != shapes[name]
    ]
    rows = {} if faults else {name: np.argwhere(~np.isfinite(arrays[name])) for name in finite}
    return faults + [f"{name} is not finite in row {bad[0, 0]}" for name, bad in rows.items() if len(bad)]


def exceeds(what: str, size: Floats, limit: float, t: Floats, unit: str) -> Iterator[str]:
    """Yield that `what` happens, with the largest of these sizes and its time, if one of them is above a limit."""
    worst = int(np.argmax(size))
    if not size[worst] <= limit + _NEAR:
        yield f"{what}: {size[worst]:.7g} {unit} at {t[worst]:g} s"


def braking(spec: RobotSpec) -> float:
    """Return a robot's limit of deceleration, m/s^2."""
    return spec.a_max if spec.brake_max is None else spec.brake_max


def angle(difference: Floats) -> Floats:
    """Return a difference of angles in [-pi, pi], rad."""
    return np.arctan2(np.sin(difference), np.cos(difference))


def not_along(trace: Trace) -> NDArray[np.bool_]:
    """Tell for each step whether a holonomic robot does not point where it goes; at rest, or with a footprint, as before."""
    v, heading = trace.velocity[1:], trace.heading
    keeps = (np.hypot(*v.T) <= REST) | (trace.task.robot.footprint is not None)
    return np.abs(angle(np.where(keeps, heading[:-1], np.arctan2(v[:, 1], v[:, 0])) - heading[1:])) > _NEAR


def driven(trace: Trace) -> tuple[Floats, Floats, Floats]:
    """Drive each cycle again; return times float64[N, S], states (x, y, theta) float64[N, S, 3], last speeds float64[N, 2].

    Each cycle starts at its row of the trace. Speeds are (v, omega) for wheels, else (vx, vy).
    """
    spec, n = trace.task.robot, len(trace.command)
    wheels = spec.drive != "holonomic"
    drive = _roll if wheels else _glide
    (x, y), (vx, vy), theta = trace.xy[:-1].T.copy(), trace.velocity[:-1].T.copy(), trace.heading[:-1].copy()
    state: State = x, y, theta, vx, vy
    if wheels:
        state = x, y, theta, vx * np.cos(theta) + vy * np.sin(theta), trace.turn_rate[:-1].copy()
    whole = math.floor(spec.latency / spec.dt + 1e-9)
    late = max(spec.latency - whole * spec.dt, 0.0)
    span = np.diff(trace.t)
    t, times, states = trace.t[:-1].copy(), [trace.t[:-1].copy()], [np.stack(state[:3], axis=-1)]
    for part in range(2):  # before and after the delayed command acts
        time = np.minimum(late, span) if part == 0 else np.maximum(span - late, 0.0)
        asked = np.zeros((n, 2))
        first = whole + 1 - part
        asked[first:] = trace.command[: max(n - first, 0)]
        asked[~np.isfinite(asked).all(axis=1)] = 0.0
        if part == 0 and late <= 1e-9 * spec.dt:
            continue
        bends = (_bends if wheels else _bend)(state, asked, spec, time)
        knots = np.sort(np.hstack((np.linspace(0.0, time, _steps(spec) + 1, axis=1), bends)), axis=1)
        for h in np.diff(knots).T:
            state, t = drive(state, asked, spec, h), t + h
            times.append(t)
            states.append(np.stack(state[:3], axis=-1))
    return np.stack(times, axis=1), np.stack(states, axis=1), np.stack(state[3:], axis=-1)


def _at_once(v: Floats, target: Floats, growth: float, fall: float) -> Floats:
    """Return the speed after the immediate effect of infinite rates; a speed that is almost 0 before it changes sign is 0."""
    through = v * target < 0.0
    v = np.where(through & (math.isinf(fall) | (np.abs(v) < 1e-12)), 0.0, v)
    falls = np.abs(target) < np.abs(v)
    at_once = (v * target >= 0.0) & np.where(falls, math.isinf(fall), math.isinf(growth))
    return np.where(at_once, target, v)


def _nearer(v: Floats, target: Floats, growth: float, fall: float, h: Floats) -> Floats:
    """Return the speed after h s on its ramp to a target; the ramp ends at 0 if the sign changes."""
    through = v * target < 0.0
    change = np.where(through, 0.0, target) - v
    with np.errstate(invalid="ignore"):
        most = np.where(through | (np.abs(target) < np.abs(v)), fall, growth) * h
    result: Floats = v + np.sign(change) * np.fmin(np.abs(change), most)
    return result


def _steps(spec: RobotSpec) -> int:
    """Return the number of small steps, of which each is within 13 micrometres of its chord if they are not the most."""
    bend = spec.v_max * spec.turn_rate * (spec.drive != "holonomic") + _finite(spec.a_max) + _finite(braking(spec))
    return math.ceil(min(max(100.0 * spec.dt * math.sqrt(bend), _STEPS[0]), _STEPS[1]))


def _bends(state: State, asked: Floats, spec: RobotSpec, time: Floats) -> Floats:
    """Return the times at which the ramps of wheels' speed reach 0 and end, and that of their turn rate ends, float64[N, 3] s.

    They are at most `time`. The steering of a car keeps |omega| <= |v| / turning_radius. Between these times both this bound
    and the ramp of omega are linear in time, so that steps that end at them give exact speeds.
    """
    v, brake = state[3], braking(spec)
    target = np.clip(asked[:, 0], -spec.v_reverse, spec.v_max)
    through = v * target < 0.0
    falls = through | (np.abs(target) < np.abs(v))
    zero = np.where(through, np.abs(v) / brake, 0.0)
    zero = np.where(np.abs(zero - time) < 1e-12, time, zero)  # at the end of its ramp a speed is 0 and does not change sign
    end = zero + np.where(through, np.abs(target) / spec.a_max, np.abs(target - v) / np.where(falls, brake, spec.a_max))
    turned = np.abs(np.clip(asked[:, 1], -spec.turn_rate, spec.turn_rate) - state[4]) / spec.alpha_max
    times: Floats = np.minimum(np.stack((zero, end, turned), axis=1), time[:, None])
    return times


def _roll(state: State, asked: Floats, spec: RobotSpec, h: Floats) -> State:
    """Drive wheels for h s in four parts: speeds by their ramps, places by the midpoint rule."""
    x, y, theta, v, w = state
    brake = braking(spec)
    cv = np.clip(asked[:, 0], -spec.v_reverse, spec.v_max)
    cw = np.clip(asked[:, 1], -spec.turn_rate, spec.turn_rate)
    turn = 1e9 if math.isinf(spec.alpha_max) else spec.alpha_max
    for _ in range(4):
        v0 = _at_once(v, cv, spec.a_max, brake)
        v1 = _nearer(v0, cv, spec.a_max, brake, h / 4)
        w0 = cw if math.isinf(spec.alpha_max) else w
        if spec.turning_radius > 0.0:
            w0 = np.clip(w0, -np.abs(v0) / spec.turning_radius, np.abs(v0) / spec.turning_radius)
        w1 = w0 + np.clip(cw - w0, -turn * h / 4, turn * h / 4)
        if spec.turning_radius > 0.0:
            w1 = np.clip(w1, -np.abs(v1) / spec.turning_radius, np.abs(v1) / spec.turning_radius)
        middle = theta + (3 * w0 + w1) / 8 * h / 4
        x = x + (v0 + v1) / 2 * np.cos(middle) * h / 4
        y = y + (v0 + v1) / 2 * np.sin(middle) * h / 4
        theta = theta + (w0 + w1) / 2 * h / 4
        v, w = np.where(h > 0, v1, v), np.where(h > 0, w1, w)
    return x, y, theta, v, w


def _ramp(state: State, asked: Floats, spec: RobotSpec) -> tuple[Floats, Floats, Floats]:
    """Return by how much a holonomic robot's velocity is to change, m/s along x and y, and how long that takes, s."""
    vx, vy = state[3:]
    size = np.hypot(*asked.T)
    cx, cy = (asked * np.where(size > spec.v_max, spec.v_max / np.where(size > 0, size, 1.0), 1.0)[:, None]).T
    dx, dy = cx - vx, cy - vy
    return dx, dy, np.hypot(dx, dy) / np.where(cx * dx + cy * dy <= EVEN, braking(spec), spec.a_max)


def _bend(state: State, asked: Floats, spec: RobotSpec, time: Floats) -> Floats:
    """Return the time at which the ramp of a holonomic robot's velocity ends, float64[N, 1] s, at most `time`."""
    bend: Floats = np.minimum(_ramp(state, asked, spec)[2], time)[:, None]
    return bend


def _glide(state: State, asked: Floats, spec: RobotSpec, h: Floats) -> State:
    """Drive a holonomic robot for h s: its velocity changes straight towards the commanded one, until `_bend` at most."""
    x, y, theta, vx, vy = state
    dx, dy, time = _ramp(state, asked, spec)
    share = np.where(time > h, h / np.where(time > 0.0, time, 1.0), 1.0) * (h > 0.0)
    ux, uy = vx + dx * share, vy + dy * share
    half = np.where(time > 0.0, 0.5, 1.0)  # of the change acts throughout the step; what changes at once acts in full
    return x + (vx + dx * share * half) * h, y + (vy + dy * share * half) * h, theta, ux, uy


class Again:
    """The cycles of a trace, each driven again at most once: what `driven` returns, and the gaps to obstacles."""

    def __init__(self, trace: Trace) -> None:
        self.trace = trace

    @cached_property
    def cycles(self) -> tuple[Floats, Floats, Floats]:
        """What `driven` returns."""
        return driven(self.trace)

    @cached_property
    def gaps(self) -> Floats:
        """What `dynamic_gaps` returns."""
        return dynamic_gaps(self.trace, *self.cycles[:2])


def dynamic_faults(again: Again) -> Iterator[str]:
    """Yield where the trace does not follow limits and commands, and where the robot passes through something."""
    trace, (_, states, speeds) = again.trace, again.cycles
    spec, wheels = trace.task.robot, trace.task.robot.drive != "holonomic"
    turns = 0.0
    if spec.turning_radius > 0.0:  # within a quarter of a small step the turn rate may meet the bound of the steering
        bound = max(_finite(spec.a_max), _finite(braking(spec))) / spec.turning_radius  # how fast that changes, rad/s^2
        turns = (_finite(spec.alpha_max) + bound) * (spec.dt / _steps(spec) / 4.0) ** 2
    if np.hypot(*(states[:, -1, :2] - trace.xy[1:]).T).max(initial=0.0) > 5 * _NEAR + spec.v_max * spec.dt * turns:
        yield "a place is not where its command leads"
    turned = np.abs(angle(states[:, -1, 2] - trace.heading[1:])) > 5 * _NEAR + turns if wheels else not_along(trace)
    if turned.any():
        yield "a heading is not where its command turns it"
    yield from _speed_faults(trace, speeds)
    gap = again.gaps
    for k in np.flatnonzero(gap.min(axis=0, initial=math.inf) < -_tolerance(trace)).tolist():
        yield f"passes through obstacle {trace.timeline.id[k]} in step {int(np.argmin(gap[:, k]))}"
    depth = [_wall_gap_within(trace, states[i]) for i in range(len(states))]
    if depth and min(depth) < -_tolerance(trace):
        yield f"passes through a wall in step {depth.index(min(depth))}"


def _speed_faults(trace: Trace, speeds: Floats) -> Iterator[str]:
    """Yield where recorded velocities exceed a limit, or are not the `speeds` to which the commands lead."""
    spec, recorded = trace.task.robot, trace.velocity
    wheels = spec.drive != "holonomic"
    if wheels:
        ahead = np.column_stack((np.cos(trace.heading), np.sin(trace.heading)))
        if np.abs(recorded[:, 0] * ahead[:, 1] - recorded[:, 1] * ahead[:, 0]).max() > _NEAR:
            yield "moves aside, which wheels do not"
        recorded = np.column_stack(((recorded * ahead).sum(axis=1), trace.turn_rate))
        yield from exceeds("is faster than v_max or v_reverse", recorded[:, 0], spec.v_max, trace.t, "m/s")
        yield from exceeds("is faster than v_max or v_reverse, backwards", -recorded[:, 0], spec.v_reverse, trace.t, "m/s")
        yield from exceeds("turns faster than turn_rate", np.abs(recorded[:, 1]), spec.turn_rate, trace.t, "rad/s")
    else:
        yield from exceeds("is faster than v_max", np.hypot(*recorded.T), spec.v_max, trace.t, "m/s")
    if (np.abs(speeds - recorded[1:]) > _NEAR).any():
        yield "a speed is not what its command leads to"


def _finite(limit: float) -> float:
    """Return a limit, or 0 if there is none: speeds that change at once bend no step."""
    return limit if math.isfinite(limit) else 0.0


def dynamic_gaps(trace: Trace, times: Floats, states: Floats) -> Floats:
    """Return the gap of robot and obstacle in each cycle, float64[N, K], m: the least at samples and at the obstacle's knots.

    Between samples it is looked at more closely where the least one of the episode, or a contact, could be.
    """
    line, ends = trace.timeline, times[:, -1]
    gap, moves = np.empty((len(times), len(line))), _moves(trace, states)
    t, state = times.ravel(), states.reshape(-1, 3)
    for k, (low, high) in enumerate(pairwise(line.first.tolist())):
        knots, places = line.knot_t[low:high], line.knot_xy[low:high]
        travelled = np.append(0.0, np.hypot(*np.diff(places, axis=0).T).cumsum())

        def gaps(at: NDArray[np.int64], share: Floats, k: int = k, knots: Floats = knots, places: Floats = places) -> Floats:
            then, here = (
                one[at] + (one[at + 1] - one[at]) * (share if one.ndim == 1 else share[:, None]) for one in (t, state)
            )
            there = np.stack([np.interp(then, knots, places[:, axis]) for axis in (0, 1)], axis=-1)
            apart: Floats = _body_distance(trace, here, there) - line.radius[k]
            return apart

        at = np.stack([np.interp(times, knots, places[:, axis]) for axis in (0, 1)], axis=-1)
        sampled = _body_distance(trace, states, at) - line.radius[k]
        moved = moves + np.diff(np.interp(times, knots, travelled), axis=1)
        gap[:, k] = _least_within(sampled, moved, gaps, _tolerance(trace), CLOSE / 2.0)
        for when, place in zip(knots, places):
            i = int(np.searchsorted(ends, when))
            if i < len(times) and when > times[i, 0]:
                then = np.array([np.interp(when, times[i], states[i, :, axis]) for axis in range(3)])
                gap[i, k] = min(gap[i, k], float(_body_distance(trace, then, place)) - line.radius[k])
    return gap


def _tolerance(trace: Trace) -> float:
    """Return the depth of a contact that may go unseen, m: less for a disc that is hardly larger, or cells that are."""
    spec = trace.task.robot
    return min(_SLACK, spec.radius / 4.0 if spec.footprint is None else math.inf, trace.task.grid.resolution / 4.0)


def _moves(trace: Trace, states: Floats) -> Floats:
    """Return how far any point of the body moves from each sample [..., S, 3] to the next one, float64[..., S - 1], m."""
    step, spec = np.diff(states, axis=-2), trace.task.robot
    far: Floats = np.hypot(step[..., 0], step[..., 1])
    return far if spec.footprint is None else far + np.abs(step[..., 2]) * spec.radius


def _least_within(
    gap: Floats, moves: Floats, gaps: Callable[[NDArray[np.int64], Floats], Floats], tolerance: float, close: float
) -> Floats:
    """Return the least gap in each cycle, float64[N], from those at its samples, float64[N, S], m.

    The intervals between samples are halved until there is a contact deeper than `tolerance`, m, or none is left in which such
    a contact, or a gap smaller than the least one of all cycles by more than `close`, m, is possible. In a whole interval robot
    and obstacle together move by `moves`, float64[N, S - 1], m. `gaps` returns the gap at a share in [0, 1] of an interval,
    which is given by the number of its first sample among all N S.
    """
    least: Floats = gap.min(axis=1)
    samples = gap.shape[1]
    row, column = np.indices(moves.shape).reshape(2, -1)
    at: NDArray[np.int64] = row * samples + column
    moved, before, beyond = moves.ravel(), gap[:, :-1].ravel(), gap[:, 1:].ravel()
    low, high = np.zeros(len(at)), np.ones(len(at))
    while least.min(initial=0.0) >= -tolerance:
        open_ = (before + beyond - moved * (high - low)) / 2.0 < max(least.min(initial=math.inf) - close, -tolerance)
        moved, before, beyond, low, high = (one[open_] for one in (moved, before, beyond, low, high))
        at = at[open_]
        if not len(at):
            break
        middle = (low + high) / 2.0
        found = gaps(at, middle)
        np.minimum.at(least, at // samples, found)
        at, moved, low, high = np.tile(at, 2), np.tile(moved, 2), np.append(low, middle), np.append(middle, high)
        before, beyond = np.append(before, found), np.append(found, beyond)
    return least


def _wall_gap_within(trace: Trace, states: Floats) -> float:
    """Return the least gap to walls in a cycle with the samples float64[S, 3], m; below 0 in a wall."""

    def gaps(at: NDArray[np.int64], share: Floats) -> Floats:
        return wall_gaps(trace, states[at] + (states[at + 1] - states[at]) * share[:, None])

    gap, moves = wall_gaps(trace, states)[None], _moves(trace, states)[None]
    return float(_least_within(gap, moves, gaps, _tolerance(trace), math.inf)[0])


def _corners(trace: Trace) -> Floats:
    spec = trace.task.robot
    return np.zeros((1, 2)) if spec.footprint is None else np.array(spec.footprint)


def _body_distance(trace: Trace, states: Floats, points: Floats) -> Floats:
    """Return the distance of points [..., 2] from the robot at states [..., 3]; below 0 inside."""
    dx, dy = points[..., 0] - states[..., 0], points[..., 1] - states[..., 1]
    spec = trace.task.robot
    away: Floats = np.hypot(dx, dy)
    if spec.footprint is None:
        return away - spec.radius
    c, s = np.cos(states[..., 2]), np.sin(states[..., 2])
    px, py = c * dx + s * dy, c * dy - s * dx
    corners, outside, nearest = _corners(trace), np.full(away.shape, -math.inf), np.full(away.shape, math.inf)
    for p, q in zip(corners, np.roll(corners, -1, axis=0)):
        ex, ey = q - p
        length = math.hypot(ex, ey)
        outside = np.maximum(outside, ((px - p[0]) * ey - (py - p[1]) * ex) / length)
        share = np.clip(((px - p[0]) * ex + (py - p[1]) * ey) / length**2, 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(px - p[0] - share * ex, py - p[1] - share * ey))
    return np.where(outside > 0.0, nearest, outside)


def gap_from_square(xs: Floats, ys: Floats, half: float) -> Floats:
    """Return the gap of bodies from the square of half edge `half` around (0, 0), m; corners are float64[S, N] or [S, 1].

    For polygons it is the widest gap along the normals of either one: 0 where they touch, and at most the distance.
    """
    if xs.shape[1] == 1:
        return np.hypot(np.maximum(np.abs(xs[:, 0]) - half, 0.0), np.maximum(np.abs(ys[:, 0]) - half, 0.0))
    apart: Floats = np.maximum.reduce([xs.min(axis=1), -xs.max(axis=1), ys.min(axis=1), -ys.max(axis=1)]) - half
    for k in range(xs.shape[1]):
        ex, ey = xs[:, k] - xs[:, k - 1], ys[:, k] - ys[:, k - 1]
        length = np.hypot(ex, ey)
        nx, ny = ey / length, -ex / length  # outward normal, as the corners are counterclockwise
        apart = np.maximum(apart, -nx * xs[:, k] - ny * ys[:, k] - half * (np.abs(nx) + np.abs(ny)))
    return apart


def wall_gaps(trace: Trace, states: Floats) -> Floats:
    """Return the distance to blocked squares and map edges in each of the states float64[S, 3], m; below 0 inside."""
    grid, spec = trace.task.grid, trace.task.robot
    (x0, y0, _), size, (rows, cols) = grid.origin, grid.resolution, grid.shape
    corners, rounding = _corners(trace), spec.radius if spec.footprint is None else 0.0
    c, s = np.cos(states[:, 2]), np.sin(states[:, 2])
    xs = states[:, :1] + c[:, None] * corners[:, 0] - s[:, None] * corners[:, 1]  # [S, corners]
    ys = states[:, 1:2] + s[:, None] * corners[:, 0] + c[:, None] * corners[:, 1]
    least: Floats = np.minimum.reduce([xs - x0, x0 + cols * size - xs, ys - y0, y0 + rows * size - ys]).min(axis=1)
    margin = spec.radius + size
    j0, j1 = math.floor((states[:, 0].min() - x0 - margin) / size), math.ceil((states[:, 0].max() - x0 + margin) / size)
    i0, i1 = math.floor((states[:, 1].min() - y0 - margin) / size), math.ceil((states[:, 1].max() - y0 + margin) / size)
    near = grid.blocked[max(i0, 0) : max(i1, 0), max(j0, 0) : max(j1, 0)]
    for i, j in np.argwhere(near).tolist():
        cx, cy = x0 + (j + max(j0, 0) + 0.5) * size, y0 + (i + max(i0, 0) + 0.5) * size
        least = np.minimum(least, gap_from_square(xs - cx, ys - cy, size / 2.0))
    return least - rounding


def last_gaps(trace: Trace) -> tuple[list[float], float]:
    """Return the distances of the robot in the last row from each obstacle, and from walls."""
    state = np.array([*trace.xy[-1], trace.heading[-1]])
    line = trace.timeline
    gaps = []
    for k, (low, high) in enumerate(pairwise(line.first.tolist())):
        at = [np.interp(trace.t[-1], line.knot_t[low:high], line.knot_xy[low:high, axis]) for axis in (0, 1)]
        gaps.append(float(_body_distance(trace, state, np.array(at)) - line.radius[k]))
    return gaps, float(wall_gaps(trace, state[None])[0])
