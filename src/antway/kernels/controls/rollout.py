"""The parts of what a rollout costs: obstacles, time lost to ramps and turns, a stop behind a wall."""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.controls.lookup import clearance, footprint_distance, slope
from antway.kernels.controls.motion import MotionState
from antway.kernels.controls.problem import (
    GOAL_SPEED,
    GOAL_X,
    GOAL_Y,
    TOLERANCE,
    ControlProblem,
    NearObstacle,
    StaticField,
    near_at,
)

_FIRST_STEP = 3.0  # 1; weight of a stop that the guard would refuse at the first step; at later steps it is the decay
_ALONG = 0.9  # 1; cosine of the angle between the directions of the robot and of an obstacle that it follows, at least


@inner_kernel
def _nearest_in_step(dx: float, dy: float, moved_x: float, moved_y: float) -> tuple[float, float]:
    """Return where a robot is from an obstacle when it is nearest to it in a step, m.

    It is at (dx, dy) from the obstacle at the end of the step, in which it has moved so far, seen from the obstacle.
    """
    back, square = dx * moved_x + dy * moved_y, moved_x * moved_x + moved_y * moved_y
    if 0.0 < back < square:  # the robot passes the obstacle within the step
        return dx - back / square * moved_x, dy - back / square * moved_y
    return dx, dy  # it was nearer at the end of the step before, which has been judged, or is nearest now


@inner_kernel
def obstacle_cost(before: MotionState, at: MotionState, k: int, decay: float, problem: ControlProblem, costs: Floats) -> float:
    """Return the cost of obstacles in step k, from `before` to `at`, s.

    These are contacts, close passes, stops that they could enter, and stops too near behind those of obstacles ahead.
    `costs`, float64[M], is the sequence's row of `Batch.harm`.
    """
    limits, dt, field, outlook, w = problem.limits, problem.dt, problem.field, problem.outlook, problem.weights
    speed = abs(at.a) if limits.drive != HOLONOMIC else math.sqrt(at.a * at.a + at.b * at.b)
    guarded, has_box = w.stop > 0.0 and speed > 1e-3, len(field.discs) > 0
    stop_x, stop_y, stop_after, cost = at.x, at.y, 0.0, 0.0
    if guarded:
        stop_x, stop_y = _standing_place(at, speed, 0.0, limits)
        stop_after = w.stopping_time + max(speed, w.least_speed) / limits.brake_max
    if k == 0 and w.follow > 0.0 and speed > 1e-3:
        cost += w.follow * _depth_behind(at, speed, problem)
    for i in range(outlook.near[k]):
        disc = near_at(outlook, k, i)
        dx, dy = at.x - disc.x, at.y - disc.y
        moved_x, moved_y = at.x - before.x - disc.vx * dt, at.y - before.y - disc.vy * dt
        from_x, from_y, square = dx - moved_x, dy - moved_y, dx * dx + dy * dy
        if has_box:  # a corner of it may have been nearer in the step than its centre is at the end
            square = min(square, from_x * from_x + from_y * from_y)
        if square < outlook.beyond[k, 2, i]:
            if has_box:
                distance = footprint_distance(field, before, from_x, from_y, at, dx, dy)
            else:
                dx, dy = _nearest_in_step(dx, dy, moved_x, moved_y)
                distance = math.sqrt(dx * dx + dy * dy)
            cost += w.near * max(disc.preferred - distance, 0.0)
            harm = 0.0
            if distance < disc.risky:
                share = min((disc.risky - distance) / (disc.risky - disc.contact), 1.0)
                harm += w.risk * share * share
            if w.turn_risk > 0.0 and distance < disc.turn_distance:
                share = min((disc.turn_distance - distance) / (disc.turn_distance - disc.contact), 1.0)
                harm += w.turn_risk * disc.turn_time * share
            if distance < disc.contact:
                harm += w.contact + w.contact * (disc.contact - distance)
            harm, owner = decay * harm, int(disc.owner)
            if len(costs) == 0:
                cost += harm
            elif harm > costs[owner]:
                cost += harm - costs[owner]
                costs[owner] = harm
        if guarded:
            depth = _depth_in_stop(disc, stop_x, stop_y, stop_after, w.swerve)
            if depth > 0.0:
                cost += (_FIRST_STEP if k == 0 else decay) * w.stop * depth
    return cost


@inner_kernel
def _standing_place(at: MotionState, speed: float, delay: float, limits: RobotLimits) -> tuple[float, float]:
    """Return where a robot at `speed` m/s > 0 stands after it has driven on for `delay` s and braked, in a straight line."""
    span = speed * delay + 0.5 * speed * speed / limits.brake_max
    if limits.drive != HOLONOMIC:
        span = math.copysign(span, at.a)
        return at.x + span * at.cos, at.y + span * at.sin
    return at.x + span * at.a / speed, at.y + span * at.b / speed


@inner_kernel
def _depth_behind(at: MotionState, speed: float, problem: ControlProblem) -> float:
    """Return how deep in the stop of an obstacle ahead the robot would stop if both braked from the end of the first step, m.

    This is the safe distance of Shalev-Shwartz, Shammah and Shashua, "On a formal model of safe and scalable self-driving cars"
    (2017), definition 1, in the plane: the obstacle, which moves in about the same direction, brakes at once, as hard as
    it may change its velocity, and the robot after its stopping time. Of all obstacles the greatest depth counts.
    """
    outlook, depth = problem.outlook, 0.0
    x, y = _standing_place(at, speed, problem.weights.stopping_time, problem.limits)
    along_x, along_y = x - at.x, y - at.y
    span = math.sqrt(along_x * along_x + along_y * along_y)
    for i in range(outlook.near[0]):
        disc = near_at(outlook, 0, i)
        vx, vy, pace = disc.vx, disc.vy, math.sqrt(disc.vx * disc.vx + disc.vy * disc.vy)
        ahead = along_x * (disc.x - at.x) + along_y * (disc.y - at.y) > 0.0
        if ahead and along_x * vx + along_y * vy > _ALONG * span * pace:
            half = 0.5 * pace / max(problem.weights.swerve, 1e-9)  # s; half of the time in which the obstacle brakes
            dx, dy = x - disc.x - half * vx, y - disc.y - half * vy
            depth = max(depth, disc.contact - math.sqrt(dx * dx + dy * dy))
    return depth


@inner_kernel
def _depth_in_stop(disc: NearObstacle, x: float, y: float, after: float, swerve: float) -> float:
    """Return how far the obstacle can be within contact distance of a robot that stands at (x, y) `after` s from now, m.

    Two bounds on where the obstacle can be are used: it is no faster than its speed bound; and until a wall changes its
    velocity, that changes by no more than `swerve` m/s^2.
    """
    most = disc.contact + disc.speed * after
    dx, dy = x - disc.x, y - disc.y
    square = dx * dx + dy * dy
    if square >= most * most:
        return 0.0
    depth: float = most - math.sqrt(square)
    if swerve < math.inf:
        drift = min(after, disc.straight)
        dx, dy = dx - disc.vx * drift, dy - disc.vy * drift
        most = disc.contact + 0.5 * swerve * drift * drift + disc.speed * (after - drift)
        depth = min(depth, most - math.sqrt(dx * dx + dy * dy))
    return depth


@inner_kernel
def _braking_time(speed: float, slow: float, most: float, limits: RobotLimits) -> float:
    """Return how long a robot brakes to `slow` m/s; if it needs more than `most` m for that, it comes back as far, s."""
    past = max((speed * speed - slow * slow) / (2.0 * limits.brake_max) - most, 0.0)
    return (speed - slow) / limits.brake_max + math.sqrt(2.0 * past * (1.0 / limits.a_max + 1.0 / limits.brake_max))


@inner_kernel
def _loss_at_goal(at: MotionState, goal: Floats, limits: RobotLimits) -> float:
    """Return how long a robot within the goal's tolerance still brakes until it is slow enough, s."""
    speed = math.sqrt(at.a * at.a + at.b * at.b) if limits.drive == HOLONOMIC else abs(at.a)
    slow, tolerance = goal[GOAL_SPEED], goal[TOLERANCE]
    if speed <= slow:
        return 0.0
    vx, vy = (at.a, at.b) if limits.drive == HOLONOMIC else (at.a * at.cos, at.a * at.sin)
    dx, dy = goal[GOAL_X] - at.x, goal[GOAL_Y] - at.y
    along = (vx * dx + vy * dy) / speed
    chord = along + math.sqrt(max(along * along + tolerance * tolerance - dx * dx - dy * dy, 0.0))
    return _braking_time(speed, slow, chord, limits)


@inner_kernel
def _ramp_loss(along: float, top: float, to_go: float, goal: Floats, limits: RobotLimits) -> float:
    """Return the time lost by a robot at `along` m/s that can drive at `top` m/s, on a path of `to_go` s at `v_max` m/s, s.

    The robot arrives no faster than the goal asks.
    """
    far, slow, a_max, brake_max = to_go * limits.v_max, goal[GOAL_SPEED], limits.a_max, limits.brake_max
    if slow == math.inf:
        lack = max(top - along, 0.0)
        if 2.0 * a_max * far >= top * top - along * along:
            return 0.5 * lack * lack / (a_max * top) + far / top - to_go
        return (math.sqrt(along * along + 2.0 * a_max * far) - along) / a_max - to_go
    slow = min(slow, math.sqrt(along * along + 2.0 * a_max * far))
    if along > slow and along * along - slow * slow >= 2.0 * brake_max * far:
        return _braking_time(along, slow, far + 2.0 * goal[TOLERANCE], limits) - to_go
    square = (2.0 * a_max * brake_max * far + brake_max * along * along + a_max * slow * slow) / (a_max + brake_max)
    peak = min(math.sqrt(square), max(top, along))
    ramps = (peak * peak - along * along) / (2.0 * a_max) + (peak * peak - slow * slow) / (2.0 * brake_max)
    time: float = (peak - along) / a_max + (peak - slow) / brake_max + max(far - ramps, 0.0) / peak
    return time - to_go


@bare_kernel
def lost_time(at: MotionState, to_go: float, field: StaticField, limits: RobotLimits) -> float:
    """Return the time that a robot loses to ramps and turns, in addition to its static time to the goal `to_go` s, s.

    A robot on wheels turns to the steepest descent while it drives. A turn by the angle phi at full rate costs
    (phi - sin phi) / rate. If the robot can reverse and that takes less time, it drives there in reverse.
    """
    if to_go <= 0.0:
        return _loss_at_goal(at, field.goal, limits)
    gx, gy, steep = slope(field, at.x, at.y, 1.0 / field.time_frame[2])
    if steep < 1e-9:
        return 0.0
    dx, dy = -gx / steep, -gy / steep
    if limits.drive == HOLONOMIC:
        return _ramp_loss(at.a * dx + at.b * dy, limits.v_max, to_go, field.goal, limits)
    ahead, radius = at.cos * dx + at.sin * dy, max(limits.turning_radius, 1e-9)
    phi = math.acos(min(max(ahead, -1.0), 1.0))
    lost = _ramp_loss(at.a, limits.v_max, to_go, field.goal, limits)
    lost += (phi - math.sin(phi)) / min(limits.turn_rate, limits.v_max / radius)
    if limits.v_reverse > 0.0:
        phi = math.pi - phi
        back = _ramp_loss(-at.a, limits.v_reverse, to_go, field.goal, limits)
        lost = min(lost, back + (phi - math.sin(phi)) / min(limits.turn_rate, limits.v_reverse / radius))
    return lost


@inner_kernel
def stop_behind_wall(at: MotionState, limits: RobotLimits, field: StaticField) -> float:
    """Return the part, 0 to 1, of the robot's stop in a straight line that lies behind a wall."""
    vx, vy = (at.a, at.b) if limits.drive == HOLONOMIC else (at.a * at.cos, at.a * at.sin)
    speed = max(math.hypot(vx, vy), 1e-9)
    dx, dy = vx / speed, vy / speed
    span, far = 0.5 * speed * speed / limits.brake_max, 0.0
    while far < span:
        wall = clearance(field, MotionState(at.x + far * dx, at.y + far * dy, at.cos, at.sin, at.a, at.b), 0.0)
        if wall < 0.0:
            return 1.0 - far / span
        far += max(wall, 0.02)
    return 0.0


@inner_kernel
def is_too_dear(limit: float, cost: float, left: int, to_go: float, plan_to_go: float, dt: float, progress: float) -> bool:
    """Tell whether a rollout with `left` steps to come is sure to cost more than `limit`.

    In a step its time to go decreases by at most `dt`, and costs at least what is left of it. If the rollout cannot reach the
    goal any more, each step costs at least as much as the plan still takes.
    """
    span = left * dt
    ahead = min(left, to_go / dt)  # least number of steps to the goal
    if cost + to_go - span + progress * ahead * (to_go - 0.5 * ahead * dt) > limit:
        return True
    later = progress * left * (plan_to_go - 0.5 * (left + 1) * dt) if left > 0 else 0.0  # without a plan it is -infinity
    return to_go > span and cost + plan_to_go - span + later > limit
