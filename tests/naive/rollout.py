"""What a sequence of controls costs, as the definition says it, and the best of all sequences of arcs."""

from __future__ import annotations

import cmath
import itertools
import math

import numpy as np

from antway.kernels.base.records import RobotLimits, RobotState
from antway.kernels.controls.problem import ControlProblem, StaticField
from antway.kernels.controls.seeds import descend, downhill
from antway.kernels.robot.motion import drive_cycle

Corners = tuple[tuple[float, float], ...]


def bilinear(field: np.ndarray, x: float, y: float, frame: np.ndarray) -> float:
    c, r = (x - frame[0]) * frame[2], (y - frame[1]) * frame[2]
    c, r = min(max(c, 0.0), field.shape[1] - 1.001), min(max(r, 0.0), field.shape[0] - 1.001)
    i, j = int(r), int(c)
    weights = {(i, j): (i + 1 - r) * (j + 1 - c), (i, j + 1): (i + 1 - r) * (c - j)}
    weights |= {(i + 1, j): (r - i) * (j + 1 - c), (i + 1, j + 1): (r - i) * (c - j)}
    return sum(share * float(field[cell]) for cell, share in weights.items())


def turned(heading: float) -> np.ndarray:
    """Matrix that turns a vector of the map into the frame of a robot with this heading."""
    return np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])


def _from_footprint(point: np.ndarray, corners: Corners) -> float:
    """Distance in m of a point in the robot's frame from its footprint, edge by edge; 0 within it."""
    edges = [(np.array(p), np.array(q)) for p, q in zip(corners, corners[1:] + corners[:1])]
    if all((q - p)[0] * (point - p)[1] >= (q - p)[1] * (point - p)[0] for p, q in edges):
        return 0.0
    along = [min(max((point - p) @ (q - p) / ((q - p) @ (q - p)), 0.0), 1.0) for p, q in edges]
    return min(math.dist(point, p + share * (q - p)) for share, (p, q) in zip(along, edges))


def _shares(parts: int) -> list[float]:
    return [(k + 1) / parts for k in range(parts)]


def _on_the_way(before: np.ndarray, heading: float, now: RobotState, theta: float, share: float) -> tuple[np.ndarray, float]:
    """Place and heading after a share of a step along a circle that turns by the change of the heading."""
    half = math.remainder(theta - heading, math.tau) / 2.0
    part = share if half == 0.0 else math.sin(share * half) / math.sin(half)
    along = complex(now.x - before[0], now.y - before[1]) * part * cmath.exp(1j * (share - 1.0) * half)
    return before + np.array([along.real, along.imag]), heading + share * 2.0 * half


def spacing_of(limits: RobotLimits, dt: float) -> float:
    """How far apart in a step walls are looked for, m: so that a corner is cut by 5 mm at most, also from rest."""
    first = min(limits.v_max, limits.a_max * dt) * dt
    return math.sqrt(0.04 * limits.radius) if first**2 / (8.0 * limits.radius) > 0.005 else math.inf


def _wall_at(xy: np.ndarray, theta: float, field: StaticField) -> float:
    """Distance in m from walls of the disc around the robot or, if that is more, of the smaller discs that cover it."""
    if not len(field.discs):
        return bilinear(field.wall, *xy, field.wall_frame)
    centres = xy + field.discs[:, :2] @ turned(theta)
    smaller = min(bilinear(field.wall, *at, field.wall_frame) + less for at, less in zip(centres, field.discs[:, 2]))
    return max(bilinear(field.wall, *xy, field.wall_frame), smaller)


def cost_of(controls: np.ndarray, problem: ControlProblem, corners: Corners = ()) -> float:
    """The cost as its definition says it, of a robot that drives exactly."""
    state, limits, dt, field, outlook, w, batch = problem
    now, cost, harm = state, 0.0, dict.fromkeys(range(batch.harm.shape[1]), 0.0)
    arrived = math.inf  # the step at the end of which the robot is at the goal
    for k, (ca, cb) in enumerate(controls.tolist()):
        if k * dt > arrived * dt + max(w.stopping_time - dt, 0.0) + 1e-9:
            ca = cb = 0.0
        before, heading, last, now = np.array(now[:2]), now[2], now, drive_cycle(now, ca, cb, limits, dt)
        cost += w.turn_change * abs(now[4] - last[4])
        x, y, theta, a, b = now
        if not limits.drive:  # without wheels a footprint keeps its heading
            theta = heading = state.theta
        decay = math.exp(-w.decay * k * dt)
        spacing = 0.02 if len(field.discs) and not limits.drive else spacing_of(limits, dt)
        parts = max(math.ceil(math.dist((x, y), before) / spacing), 1)
        wall = min(_wall_at(*_on_the_way(before, heading, now, theta, s), field) for s in _shares(parts))
        if wall < w.wall_margin:
            cost += w.wall * decay * (1.0 + 10.0 * (w.wall_margin - wall))
        elif wall < w.wall_margin + w.wall_range:
            cost += w.wall_risk * dt * decay * (w.wall_margin + w.wall_range - wall) / w.wall_range
        speed = abs(a) if limits.drive else math.hypot(a, b)
        course = (
            math.copysign(1.0, a) * np.array([math.cos(theta), math.sin(theta)])
            if limits.drive
            else np.array([a, b]) / max(speed, 1e-9)
        )
        stands = np.array([x, y]) + course * speed**2 / (2.0 * limits.brake_max)
        late = w.stopping_time + max(speed, w.least_speed) / limits.brake_max
        follows = k == 0 and speed > 1e-3
        cost += w.follow * _depth_behind(now, course, speed, problem) if follows else 0.0
        for disc in outlook.disc[k, : outlook.near[k]].tolist():
            cx, cy, contact, preferred, top, vx, vy, straight, risky, owner, turn_distance, turn_time = disc
            share = np.linspace(0.0, 1.0, 2001)[:, None]
            offsets = [cx, cy] - (1.0 - share) * dt * [vx, vy] - before - share * ([x, y] - before)
            nearest = int(np.hypot(*offsets.T).argmin()) or -1  # the start of the step is judged as the end of the last
            away = math.hypot(*offsets[nearest])
            if len(field.discs):
                turns = heading + share[::40, 0] * math.remainder(theta - heading, math.tau)
                gaps = [_from_footprint(turned(angle) @ at, corners) for angle, at in zip(turns, offsets[::40])]
                away = gaps[int(np.argmin(gaps)) or -1] + field.box[4]
            cost += w.near * max(preferred - away, 0.0)
            danger = 0.0
            if away < risky:
                danger += decay * w.risk * min((risky - away) / (risky - contact), 1.0) ** 2
            if away < turn_distance:
                danger += decay * w.turn_risk * turn_time * min((turn_distance - away) / (turn_distance - contact), 1.0)
            if away < contact:
                danger += decay * w.contact * (1.0 + contact - away)
            harm[owner] = max(harm[owner], danger) if batch.harm.size else harm.get(owner, 0.0) + danger
            t = min(late, straight)
            far = math.hypot(stands[0] - cx, stands[1] - cy)
            drifted = math.hypot(stands[0] - cx - vx * t, stands[1] - cy - vy * t)
            reach = contact + 0.5 * w.swerve * t * t + top * (late - t)
            short = max(min(contact + top * late - far, reach - drifted), 0.0)
            cost += w.stop * short * (3.0 if k == 0 else decay)
        cost -= w.stand if k == 0 and a == b == 0.0 else 0.0
        pace = math.hypot(a, b)
        if math.hypot(x - field.goal[0], y - field.goal[1]) < field.goal[2] and pace <= field.goal[3]:
            arrived = min(arrived, k)
        if arrived < math.inf:
            if a == b == 0.0:
                break
            continue
        px, py, left = outlook.plan[k].tolist()
        to_go = max(bilinear(field.time, x, y, field.time_frame), 0.0)
        value = max(to_go, left + w.off_plan * math.hypot(x - px, y - py))
        cost += w.progress * value
    cost += sum(harm.values())
    if arrived < math.inf:
        return cost - (len(controls) - 1 - arrived) * dt
    cost += afterwards_of(now, problem, math.exp(-w.decay * len(controls) * dt), harm)
    return cost + max(value, to_go + w.ramps * lost_of(now, limits, field)) + w.turn_change * abs(now[4])


def outlook_of(tracks, sigma, now, dt, steps, start, bounds, margins, change) -> list[dict[int, tuple[list[float], float]]]:
    """At the end of each step, and at the end of all for the time after it: what is near of the tracks, and how near it is.

    Of each track (its segments) its number, the row of `NearObstacle` without the owner, and the gap to the robot's start.
    """
    found: list[dict[int, tuple[list[float], float]]] = []
    for k in [*range(steps), steps - 1]:
        ahead, last = dt * (k + 1), len(found) == steps
        found.append({})
        t = now + ahead
        for number, (segments, (place, speed)) in enumerate(zip(tracks, sigma)):
            present = [i for i, one in enumerate(segments) if one[0] - 1e-9 <= t < one[1] - 1e-9]
            if not present:
                continue
            i = present[0]
            t0, _, x, y, vx, vy, contact, _ = segments[i]
            changes = [one[0] for one in segments[i:] if (one[4:6] != (vx, vy)).any()]
            x, y, pace, contact = x + vx * (t - t0), y + vy * (t - t0), math.hypot(vx, vy), contact + margins.margin
            top = max(min(pace + bounds.growth, bounds.obstacle), pace)
            since = np.linspace(0.0, ahead, 20_001)
            turned = (change * since - margins.agility * np.maximum(since - margins.response, 0.0) ** 2 / 2.0).max()
            unsure = margins.spread * math.hypot(place, speed * (margins.late + min(ahead, margins.spread_time)))
            row = [x, y, contact, contact + margins.preferred_gap, top, vx, vy, min(changes, default=math.inf) - t]
            row += [contact + unsure, contact + turned, min(ahead, margins.response + change / margins.agility)]
            nearer = bounds.v_max * ahead + (bounds.v_max + pace) * 3.0 * last
            stops = (top + bounds.v_max / 2.0) * bounds.stopping_time
            away = math.hypot(x - start.x, y - start.y)
            if away < contact + max(margins.preferred_gap, unsure, turned, stops) + nearer + 0.01:  # a centimetre to spare
                found[-1][number] = row, away - contact
    return found


def _depth_behind(now: tuple[float, ...], course: np.ndarray, speed: float, problem: ControlProblem) -> float:
    """Overlap of both stops if what it follows brakes at once, and the robot after its stopping time, m."""
    depth, outlook = 0.0, problem.outlook
    robot = speed * problem.weights.stopping_time + speed**2 / (2.0 * problem.limits.brake_max)
    for cx, cy, contact, _, _, vx, vy, *_ in outlook.disc[0, : outlook.near[0]].tolist():
        pace = math.hypot(vx, vy)
        ahead = course @ (np.array([cx, cy]) - now[:2]) > 0.0
        if ahead and course @ (vx, vy) > 0.9 * pace:
            other = np.array([cx, cy]) + np.array([vx, vy]) / pace * pace**2 / (2.0 * problem.weights.swerve)
            depth = max(depth, contact - math.dist(other, now[:2] + robot * course))
    return depth


def _downhill(x: float, y: float, field: StaticField) -> np.ndarray:
    cell = 1.0 / field.time_frame[2]
    return np.array(
        [
            bilinear(field.time, x - dx, y - dy, field.time_frame) - bilinear(field.time, x + dx, y + dy, field.time_frame)
            for dx, dy in ((cell, 0.0), (0.0, cell))
        ]
    )


def afterwards_of(state: tuple[float, ...], problem: ControlProblem, decay: float, harm: dict[int, float]) -> float:
    """What obstacles cost in the 3 s after a rollout, with each of nine motions followed in small steps; the least counts."""
    x, y, theta, a, b = state
    limits, field, outlook, w = problem.limits, problem.field, problem.outlook, problem.weights
    discs = outlook.disc[-1, : outlook.near[-1]].tolist()
    if not discs or not problem.batch.harm.size:
        return 0.0
    t, down = np.linspace(0.0, 3.0, 6001), _downhill(x, y, field)
    down /= np.hypot(*down)
    costs = []
    for angle in (*np.radians((0, 45, -45, 90, -90, 135, -135, 180)), None):
        moves, cost = np.zeros(len(t)), 1.5
        if angle is not None:
            cost = 1.5 * (1.0 - math.cos(angle))
            u = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]) @ down
            speed = limits.v_max
            if limits.drive:
                off, now = math.acos(min(max(float(u @ (math.cos(theta), math.sin(theta))), -1.0), 1.0)), a
                if off > 0.5 * math.pi and limits.v_reverse > 0.0:
                    off, now, speed = math.pi - off, -a, limits.v_reverse
                late = off / limits.turn_rate + max(speed - max(now, 0.0), 0.0) / limits.a_max / 2.0
            else:
                late = math.dist(speed * u, (a, b)) / limits.a_max / 2.0
            late = min(late, 3.0)
            free = 0
            while free < 3:
                far = speed * (3.0 - late) * (free + 1) / 3.0
                if bilinear(field.wall, x + far * u[0], y + far * u[1], field.wall_frame) < w.wall_margin:
                    break
                free += 1
            moves = speed * np.clip(t - late, 0.0, (3.0 - late) * free / 3.0)
        robot = np.array([x, y]) + moves[:, None] * (down if angle is None else u)
        for cx, cy, contact, _, _, vx, vy, straight, risky, owner, _, _ in discs:
            seen = t <= straight
            away = np.hypot(*(robot - [cx, cy] - t[:, None] * [vx, vy])[seen].T).min()
            if away < risky:
                sure = min((risky - contact) / 0.3, 1.0)
                sure *= min(math.hypot(vx, vy) / limits.v_max, 1.0)
                danger = decay * w.risk * sure * min((risky - away) / (risky - contact), 1.0) ** 2
                cost += max(danger - harm[int(owner)], 0.0)
        costs.append(cost)
    return min(costs)


def lost_of(state: tuple[float, ...], limits: RobotLimits, field: StaticField) -> float:
    """Time lost to ramps and turns, driven in small steps: on a ramp to full speed, and turning while at full speed."""
    x, y, theta, a, b = state
    goal_x, goal_y, tolerance, slow = field.goal
    h = 2e-4
    down = _downhill(x, y, field)
    to_go = max(bilinear(field.time, x, y, field.time_frame), 0.0)

    def drive(left: float, speed: float, top: float, slow: float) -> tuple[float, float, float]:
        """How long it takes, how far it then is from there and how fast it is; it arrives no faster than `slow` if it can."""
        t = 0.0
        while left > 0.0:
            brakes = speed > slow and speed**2 - slow**2 >= 2.0 * limits.brake_max * left
            faster = max(speed - limits.brake_max * h, slow) if brakes else min(speed + limits.a_max * h, max(top, speed))
            left, t, speed = left - 0.5 * (speed + faster) * h, t + h, faster
        return t, left, speed

    def ramp(speed: float, top: float, room: float) -> float:
        t, left, speed = drive(to_go * limits.v_max, speed, top, slow)
        while speed > slow:
            left, t, speed = left - speed * h, t + h, speed - limits.brake_max * h
        return t - to_go + drive(-left - room, 0.0, math.inf, 0.0)[0]

    if to_go == 0.0:
        velocity = np.array([a, b]) if not limits.drive else a * np.array([math.cos(theta), math.sin(theta)])
        ahead = np.linspace(0.0, 2.0 * tolerance, 2001) if velocity.any() else np.zeros(1)
        course = velocity / max(np.hypot(*velocity), 1e-9)
        room = ahead[np.hypot(*([x, y] + ahead[:, None] * course - [goal_x, goal_y]).T) <= tolerance].max()
        return ramp(float(np.hypot(*velocity)), limits.v_max, room)
    if not limits.drive:
        return ramp(float(np.array([a, b]) @ down / np.hypot(*down)), limits.v_max, 2.0 * tolerance)
    lost = []
    for sign, top in ((1.0, limits.v_max), (-1.0, limits.v_reverse)):
        course = sign * np.array([math.cos(theta), math.sin(theta)])
        off, turned = math.acos(min(max(float(course @ down / np.hypot(*down)), -1.0), 1.0)), 0.0
        while off > 0.0:
            turned, off = turned + h * (1.0 - math.cos(off)), off - limits.turn_rate * h
        lost.append(ramp(sign * a, top, 2.0 * tolerance) + turned)
    return min(lost)


def least_of_arcs(held: np.ndarray, block: int, arcs: int, problem: ControlProblem) -> float:
    """The least time to the goal of all sequences of arcs, each with a command held or down the field; none may touch."""
    state, limits, dt, field, _, w, batch = problem
    w = w._replace(progress=0.0, decay=0.0, contact=1e6, wall=1e6)
    w = w._replace(near=w.near / block, risk=w.risk / block, turn_risk=w.turn_risk / block)
    problem = problem._replace(batch=batch._replace(harm=np.empty((64, 0))), weights=w)
    least = math.inf
    for chosen in itertools.product(range(len(held) + 2), repeat=arcs):
        controls, now = np.empty((arcs * block, 2)), state
        for i, one in enumerate(chosen):
            part = controls[i * block : (i + 1) * block]
            if one < len(held):
                part[:] = held[one]
            else:
                here = problem._replace(start=now)
                path = np.empty((100, 2))
                points = descend(path, field, now.x, now.y, limits.v_max * block * dt)
                downhill(part, here, path, points, limits.v_max / (1 + one - len(held)), 0.0, 0)
            for ca, cb in part.tolist():
                now = drive_cycle(now, ca, cb, limits, dt)
        cost = cost_of(controls, problem)
        if cost < 1e5:
            least = min(least, arcs * block * dt + cost)
    return least
