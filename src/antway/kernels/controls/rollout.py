"""What a sequence of controls leads to: the robot's own dynamics rolled out, judged on time, obstacles and walls."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits

SX, SY, HEADING, A, B = range(5)  # of a state: place (m), heading (rad), and speed and turn rate, or the velocity's x and y
CENTRE_X, CENTRE_Y, CONTACT, WISHED, SPEED, VX, VY, STRAIGHT, LIKELY, OWNER = range(10)  # of an obstacle at the end of a step
_TURN = 1.0  # s; a turn that takes no longer is seen well enough by rollouts, and by what they lose at their end
_NOW = 3.0  # times; what a guard would not allow at once counts so much more


class StaticField(NamedTuple):
    """The map as a robot's centre meets it: distance to walls, and time to the goal."""

    wall: NDArray[np.float32]  # [h, w] m from the robot's edge, exact at the nodes of a lattice; below 0 in contact
    wall_frame: NDArray[np.float64]  # x, y of its node (0, 0), m, and nodes a metre
    time: NDArray[np.float32]  # [H, W] s at the cells' centres
    time_frame: NDArray[np.float64]
    goal: NDArray[np.float64]  # x, y and tolerance, m
    box: NDArray[np.float64]  # [5] low and high x and y in the robot's frame of a box that holds its footprint, and the radius
    # of the disc round (0, 0) that does, m
    discs: NDArray[np.float64]  # [D, 3] x, y of discs that cover that box, and by how much smaller they are than that one, m;
    # none if the robot is a disc
    turning: NDArray[np.float32]  # [K + 1, H', W'] s to the goal of a car with the heading 2 pi k / K, and last
    # of one that turns at once; empty for other robots
    turning_frame: NDArray[np.float64]


class Outlook(NamedTuple):
    """Where obstacles will be at the end of each step of a rollout, those alone that the robot could reach, and the plan."""

    near: NDArray[np.int64]  # [S] how many
    disc: NDArray[np.float64]  # [S, N, 10] x, y, distances of the centres at contact and wished (m), speed
    # bound (m/s), velocity (m/s), how long it goes on so before a wall throws it back (s), and the distance of the centres up
    # to which it is likely enough that there is contact (m), and which entry of `harm` is its own
    harm: NDArray[np.float64]  # [M] s; what each obstacle costs the rollout that is judged; none: all its steps are added up
    plan: NDArray[np.float64]  # [S, 3] x, y of a plan in space and time, m, and how long it still takes from there, s


class Margins(NamedTuple):
    """What is kept clear round obstacles."""

    margin: float  # m, added to the contact radius
    wished: float  # m, wished for beyond
    spread: float  # contact is likely enough within so many standard deviations of the place
    until: float  # s; the deviation grows no further
    late: float  # s; by so much it is ahead: a robot with inertia cannot answer at once


class CostWeights(NamedTuple):
    """What a rollout costs, in seconds."""

    progress: float  # s for each s to go at the end of each step
    contact: float  # s for a contact foreseen, and for each metre of its depth: the worst step counts, see `Outlook.harm`
    depth: float  # s/m
    decay: float  # 1/s; what is far ahead counts less
    near: float  # s/m short of the wished distance, at each step
    risk: float  # s where contact begins, where it is worst; falls with the square to nothing where it is not likely
    wall: float  # s for a wall nearer than
    wall_margin: float  # m
    off_plan: float  # s/m away from the plan
    stop: float  # s/m for a stop that a guard would not allow
    stopping_time: float  # s before a stop begins
    swerve: float  # m/s^2; no obstacle's velocity changes by more, but where a wall throws it back


@inner_kernel
def ramp(now: float, target: float, gain: float, loss: float) -> tuple[float, float]:
    """Speed at the end of a period, and its mean over it, for a linear ramp that may grow by `gain` and fall by `loss`."""
    if now * target < 0.0:
        target = 0.0 if abs(now) > loss else target
    most = gain if abs(target) > abs(now) else loss
    change = target - now
    if change > most:
        return now + most, now + 0.5 * most
    if change < -most:
        return now - most, now - 0.5 * most
    return target, target - 0.5 * change * abs(change) / most if most > 0.0 else target


@inner_kernel
def sample(field: NDArray[np.float32], x: float, y: float, frame: NDArray[np.float64]) -> float:
    """Bilinear value of a field at (x, y); outside the map the value at its edge."""
    c = min(max((x - frame[0]) * frame[2], 0.0), field.shape[1] - 1.001)
    r = min(max((y - frame[1]) * frame[2], 0.0), field.shape[0] - 1.001)
    i, j = int(r), int(c)
    u, w = r - i, c - j
    low = field[i, j] + w * (field[i, j + 1] - field[i, j])
    high = field[i + 1, j] + w * (field[i + 1, j + 1] - field[i + 1, j])
    value: float = low + u * (high - low)
    return value


@inner_kernel
def slope(field: StaticField, x: float, y: float, e: float) -> tuple[float, float, float]:
    """Differences of the time to the goal over 2 e m along x and along y, in s, and their length: uphill."""
    gx = sample(field.time, x + e, y, field.time_frame) - sample(field.time, x - e, y, field.time_frame)
    gy = sample(field.time, x, y + e, field.time_frame) - sample(field.time, x, y - e, field.time_frame)
    return gx, gy, math.hypot(gx, gy)


@inner_kernel
def step(
    x: float, y: float, c: float, s: float, a: float, b: float, ca: float, cb: float, limits: RobotLimits, dt: float
) -> tuple[float, float, float, float, float, float]:
    """State after a period of `dt` s under a command; the heading is its cosine c and sine s.

    As kernels/robot/motion.py has it, but for an arc that is taken at the heading halfway: off by less than a millimetre.
    """
    if limits.drive == HOLONOMIC:
        speed = math.hypot(ca, cb)
        if speed > limits.v_max:
            ca, cb = ca * limits.v_max / speed, cb * limits.v_max / speed
        da, db = ca - a, cb - b
        change = math.hypot(da, db)
        most = (limits.brake_max if ca * ca + cb * cb < a * a + b * b else limits.a_max) * dt
        if change > most:
            da, db = da * most / change, db * most / change
            return x + (a + 0.5 * da) * dt, y + (b + 0.5 * db) * dt, c, s, a + da, b + db
        late = 0.5 * change / most if change > 0.0 else 0.0
        return x + (a + da * (1.0 - late)) * dt, y + (b + db * (1.0 - late)) * dt, c, s, a + da, b + db
    a, mean = ramp(a, min(max(ca, -limits.v_reverse), limits.v_max), limits.a_max * dt, limits.brake_max * dt)
    most = min(limits.turn_rate, abs(a) / limits.turning_radius) if limits.turning_radius > 0.0 else limits.turn_rate
    b, spin = ramp(b, min(max(cb, -most), most), limits.alpha_max * dt, limits.alpha_max * dt)
    half = 0.5 * spin * dt
    q = half * half
    ch = 1.0 - q * (0.5 - q * (1.0 / 24.0 - q * (1.0 / 720.0)))
    sh = half * (1.0 - q * (1.0 / 6.0 - q * (1.0 / 120.0 - q * (1.0 / 5040.0))))
    mc, ms = c * ch - s * sh, s * ch + c * sh
    return x + mean * dt * mc, y + mean * dt * ms, mc * ch - ms * sh, ms * ch + mc * sh, a, b


@inner_kernel
def turning_loss(field: StaticField, x: float, y: float, c: float, s: float) -> float:
    """Time in s that a car loses to its turning radius, beyond _TURN; its heading has cosine c and sine s."""
    headings = len(field.turning) - 1
    if headings < 1:
        return 0.0
    k = math.atan2(s, c) * headings / (2.0 * math.pi)
    low = math.floor(k)
    one, other = field.turning[int(low) % headings], field.turning[int(low + 1.0) % headings]
    turned = sample(one, x, y, field.turning_frame)
    turned += (k - low) * (sample(other, x, y, field.turning_frame) - turned)
    return max(turned - sample(field.turning[headings], x, y, field.turning_frame) - _TURN, 0.0)


@inner_kernel
def clearance(x: float, y: float, c: float, s: float, enough: float, field: StaticField) -> float:
    """Distance to walls in m, of the disc that holds the robot; below `enough` that of its smaller discs, if it is more."""
    wall = sample(field.wall, x, y, field.wall_frame)
    if wall >= enough or len(field.discs) == 0:
        return wall
    least = math.inf
    for i in range(len(field.discs)):
        dx, dy = field.discs[i, 0], field.discs[i, 1]
        there = sample(field.wall, x + c * dx - s * dy, y + s * dx + c * dy, field.wall_frame) + field.discs[i, 2]
        least = min(least, there)
    return max(wall, least)


@inner_kernel
def _away(dx: float, dy: float, c: float, s: float, box: NDArray[np.float64]) -> float:
    """Distance in m from the robot's body to a place (-dx, -dy) from its centre, and its radius: as if it were a disc."""
    ahead, left = -(c * dx + s * dy), s * dx - c * dy
    out = max(box[0] - ahead, ahead - box[1], 0.0)
    side = max(box[2] - left, left - box[3], 0.0)
    away: float = math.hypot(out, side) + box[4]
    return away


@inner_kernel
def met(
    x: float,
    y: float,
    c: float,
    s: float,
    a: float,
    b: float,
    limits: RobotLimits,
    k: int,
    decay: float,
    field: StaticField,
    outlook: Outlook,
    w: CostWeights,
) -> float:
    """Cost of the obstacles at the end of step k: contacts, close passes, and a stop from here that one could cut off."""
    cost, wheels, brake = 0.0, limits.drive != HOLONOMIC, limits.brake_max
    speed = abs(a) if wheels else math.hypot(a, b)
    sx, sy, late = x, y, 0.0
    guarded = w.stop > 0.0 and speed > 1e-3
    if guarded:
        late = w.stopping_time + speed / brake
        span = 0.5 * speed * speed / brake
        if wheels:
            span = math.copysign(span, a)
            sx, sy = x + span * c, y + span * s
        else:
            sx, sy = x + span * a / speed, y + span * b / speed
    for i in range(outlook.near[k]):
        disc = outlook.disc[k, i]
        dx, dy = x - disc[CENTRE_X], y - disc[CENTRE_Y]
        square = dx * dx + dy * dy
        if square < max(disc[WISHED] * disc[WISHED], disc[LIKELY] * disc[LIKELY]):
            distance = math.sqrt(square) if len(field.discs) == 0 else _away(dx, dy, c, s, field.box)
            cost += w.near * max(disc[WISHED] - distance, 0.0)
            harm = 0.0
            if distance < disc[LIKELY]:
                share = min((disc[LIKELY] - distance) / (disc[LIKELY] - disc[CONTACT]), 1.0)
                harm += w.risk * share * share
            if distance < disc[CONTACT]:
                harm += w.contact + w.depth * (disc[CONTACT] - distance)
            harm, owner = decay * harm, int(disc[OWNER])
            if len(outlook.harm) == 0:
                cost += harm
            elif harm > outlook.harm[owner]:
                cost += harm - outlook.harm[owner]
                outlook.harm[owner] = harm
        if guarded:
            most = disc[CONTACT] + disc[SPEED] * late
            dx, dy = sx - disc[CENTRE_X], sy - disc[CENTRE_Y]
            square = dx * dx + dy * dy
            if square < most * most:
                short = most - math.sqrt(square)
                if w.swerve < math.inf:
                    drift = min(late, disc[STRAIGHT])
                    dx, dy = dx - disc[VX] * drift, dy - disc[VY] * drift
                    most = disc[CONTACT] + 0.5 * w.swerve * drift * drift + disc[SPEED] * (late - drift)
                    short = min(short, most - math.hypot(dx, dy))
                if short > 0.0:
                    cost += (_NOW if k == 0 else decay) * w.stop * short
    return cost


@inner_kernel
def _speeding_up(along: float, top: float, to_go: float, v_max: float, a_max: float) -> float:
    """Time in s that is lost until a robot at `along` m/s drives at `top` m/s, over a path of `to_go` s at `v_max` m/s."""
    far, lack = to_go * v_max, max(top - along, 0.0)
    if 2.0 * a_max * far >= top * top - along * along:
        return 0.5 * lack * lack / (a_max * top) + far / top - to_go
    return (math.sqrt(along * along + 2.0 * a_max * far) - along) / a_max - to_go


@bare_kernel
def lost_time(
    x: float, y: float, c: float, s: float, a: float, b: float, to_go: float, field: StaticField, limits: RobotLimits
) -> float:
    """Time in s that a robot loses to ramps and turns against the static time `to_go`, as it drives and points at the end.

    It turns on the way, at full rate: of the angle phi to the steepest descent that costs (phi - sin phi) / rate. Or wheels
    drive there in reverse, if that takes less.
    """
    gx, gy, steep = slope(field, x, y, 1.0 / field.time_frame[2])
    if steep < 1e-9 or to_go <= 0.0:
        return 0.0
    dx, dy = -gx / steep, -gy / steep
    if limits.drive == HOLONOMIC:
        return _speeding_up(a * dx + b * dy, limits.v_max, to_go, limits.v_max, limits.a_max)
    ahead, radius = c * dx + s * dy, max(limits.turning_radius, 1e-9)
    phi = math.acos(min(max(ahead, -1.0), 1.0))
    lost = _speeding_up(a, limits.v_max, to_go, limits.v_max, limits.a_max)
    lost += (phi - math.sin(phi)) / min(limits.turn_rate, limits.v_max / radius)
    if limits.v_reverse > 0.0:
        phi = math.pi - phi
        back = _speeding_up(-a, limits.v_reverse, to_go, limits.v_max, limits.a_max)
        lost = min(lost, back + (phi - math.sin(phi)) / min(limits.turn_rate, limits.v_reverse / radius))
    return lost


@inner_kernel
def _too_fast(x: float, y: float, c: float, s: float, a: float, b: float, limits: RobotLimits, field: StaticField) -> float:
    """Share of its speed with which a robot that brakes in a straight line meets a wall; the guard would not let it come."""
    vx, vy = (a, b) if limits.drive == HOLONOMIC else (a * c, a * s)
    speed = max(math.hypot(vx, vy), 1e-9)
    dx, dy = vx / speed, vy / speed
    span, far = 0.5 * speed * speed / limits.brake_max, 0.0
    while far < span:
        wall = clearance(x + far * dx, y + far * dy, c, s, 0.0, field)
        if wall < 0.0:
            return 1.0 - far / span
        far += max(wall, 0.02)
    return 0.0


@bare_kernel
def judge(
    controls: NDArray[np.float64],
    state: NDArray[np.float64],
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    outlook: Outlook,
    w: CostWeights,
    limit: float,
    path: NDArray[np.float64],
) -> float:
    """Cost in s of a sequence of controls, or infinity once it is sure to be above `limit`.

    Parameters
    ----------
    controls : float64[S, 2]
        Speed and turn rate, or the velocity's x and y, commanded in each period of `dt` s.
    state : float64[5]
    path : float64[P, 2]
        Filled with x, y after each step, as far as it has rows.

    Notes
    -----
    The time to go from (x, y) at a time is the static one, or what the plan still takes from where it is by then, and the path
    there, if that is more: behind a moving obstacle the map's time promises too much. A car's turns come on top. At the end of
    the sequence comes what the robot will lose to ramps and turns. A rollout that reaches the goal ends.
    """
    x, y, a, b = state[SX], state[SY], state[A], state[B]
    c, s = math.cos(state[HEADING]), math.sin(state[HEADING])
    steps, rows = len(controls), len(path)
    cost, decay = 0.0, 1.0
    outlook.harm[:] = 0.0
    slower = math.exp(-w.decay * dt)
    for k in range(steps):
        x, y, c, s, a, b = step(x, y, c, s, a, b, controls[k, 0], controls[k, 1], limits, dt)
        if k < rows:
            path[k, 0], path[k, 1] = x, y
        wall = clearance(x, y, c, s, w.wall_margin, field)
        if wall < w.wall_margin:
            cost += w.wall * decay * (1.0 + 10.0 * (w.wall_margin - wall))
        if outlook.near[k] > 0:
            cost += met(x, y, c, s, a, b, limits, k, decay, field, outlook, w)
        decay *= slower
        gx, gy = x - field.goal[0], y - field.goal[1]
        if gx * gx + gy * gy < field.goal[2] * field.goal[2]:
            for j in range(k + 1, rows):
                path[j, 0], path[j, 1] = x, y
            return cost + w.wall * decay * _too_fast(x, y, c, s, a, b, limits, field) - (steps - 1 - k) * dt
        to_go = max(sample(field.time, x, y, field.time_frame), 0.0)
        px, py = x - outlook.plan[k, 0], y - outlook.plan[k, 1]
        value: float = max(to_go, outlook.plan[k, 2] + w.off_plan * math.sqrt(px * px + py * py))
        value += turning_loss(field, x, y, c, s)
        cost += w.progress * value
        if k == steps - 1:
            return cost + value + lost_time(x, y, c, s, a, b, to_go, field, limits)
        left = steps - 1 - k
        ahead = min(left, to_go / dt)  # steps at least until the goal
        if cost + to_go - left * dt + w.progress * ahead * (to_go - 0.5 * ahead * dt) > limit:
            return math.inf
        rest = outlook.plan[k, 2]
        if to_go > left * dt and cost + rest - left * dt + w.progress * left * (rest - 0.5 * (left + 1) * dt) > limit:
            return math.inf  # it cannot reach the goal any more, and each step costs as much as the plan still takes
    return cost


@kernel
def look_ahead(
    segments: NDArray[np.float64],
    sigma: NDArray[np.float64],
    now: float,
    dt: float,
    state: NDArray[np.float64],
    v_max: float,
    braking: float,
    margins: Margins,
    speed_bound: float,
    growth: float,
    outlook: Outlook,
) -> None:
    """Fill `outlook` from motion segments (kernels/spacetime/segments.py), without those that the robot cannot come near.

    Parameters
    ----------
    segments : float64[P, 8]
        Those of one obstacle after those of another, each in the order of time.
    sigma : float64[K, 2]
        Standard deviations of each obstacle's place (m) and velocity (m/s).
    now, dt : float
        s; step k ends at now + (k + 1) dt.
    state : float64[5]
        Of the robot.
    v_max, braking : float
        Its top speed, m/s, and the time from the end of a step until it can stand, s.
    margins : Margins
    speed_bound, growth : float
        No obstacle is faster, nor faster than now by more than `growth`, m/s.
    """
    steps, size = len(outlook.near), outlook.disc.shape[1]
    outlook.near[:] = 0
    obstacle = -1
    for p in range(len(segments)):
        t0, t1 = segments[p, 0], segments[p, 1]
        if p == 0 or t0 < segments[p - 1, 1]:
            obstacle += 1
        speed = min(math.hypot(segments[p, 4], segments[p, 5]) + growth, speed_bound)
        turns = p + 1 < len(segments) and segments[p + 1, 0] == t1
        turns = turns and (segments[p + 1, 4] != segments[p, 4] or segments[p + 1, 5] != segments[p, 5])
        for k in range(max(math.ceil((t0 - now) / dt - 1e-9) - 1, 0), steps):
            t = now + (k + 1) * dt
            if t >= t1:
                break
            if t < t0 - 1e-9:
                continue
            x, y = segments[p, 2] + segments[p, 4] * (t - t0), segments[p, 3] + segments[p, 5] * (t - t0)
            grown = sigma[obstacle, 1] * (margins.late + min(t - now, margins.until))
            likely = margins.spread * math.sqrt(sigma[obstacle, 0] ** 2 + grown * grown)
            contact = segments[p, 6] + margins.margin
            far = contact + max(margins.wished, likely, speed * braking + 0.5 * v_max * braking) + v_max * (k + 1) * dt + 0.01
            dx, dy = x - state[SX], y - state[SY]
            if dx * dx + dy * dy < far * far and outlook.near[k] < size:
                row = outlook.disc[k, outlook.near[k]]
                row[CENTRE_X], row[CENTRE_Y], row[CONTACT], row[WISHED], row[SPEED] = (
                    x,
                    y,
                    contact,
                    contact + margins.wished,
                    speed,
                )
                row[VX], row[VY] = segments[p, 4], segments[p, 5]
                row[LIKELY], row[OWNER] = contact + likely, obstacle % max(len(outlook.harm), 1)
                row[STRAIGHT] = t1 - t if turns else math.inf
                outlook.near[k] += 1


@kernel
def spread_plan(
    knots: NDArray[np.float64], n: int, now: float, dt: float, arrival: float, trust: float, plan: NDArray[np.float64]
) -> None:
    """Write where the plan, knots (t, x, y), is at the end of each step, and the time it still needs, less `trust` s."""
    i = 0
    for k in range(len(plan)):
        t = now + (k + 1) * dt
        while i < n and knots[i, 0] <= t:
            i += 1
        if i == 0 or i == n:
            j = 0 if i == 0 else n - 1
            plan[k, 0], plan[k, 1] = knots[j, 1], knots[j, 2]
        else:
            u = (t - knots[i - 1, 0]) / (knots[i, 0] - knots[i - 1, 0])
            plan[k, 0] = knots[i - 1, 1] + u * (knots[i, 1] - knots[i - 1, 1])
            plan[k, 1] = knots[i - 1, 2] + u * (knots[i, 2] - knots[i - 1, 2])
        plan[k, 2] = arrival - t - trust
