"""How the velocity and heading of a robot follow a command within its limits, in steps."""

from __future__ import annotations

import math

from antway.kernels.base.geometry import wrap
from antway.kernels.base.jit import kernel
from antway.kernels.base.records import DIFFERENTIAL, RobotLimits
from antway.kernels.robot.motion import REST


@kernel
def drive(
    vx: float, vy: float, heading: float, cx: float, cy: float, limits: RobotLimits, dt: float
) -> tuple[float, float, float]:
    """Return velocity and heading after a period of `dt` s: the commanded velocity (cx, cy), m/s, as far as the limits allow.

    A holonomic robot changes its velocity vector by at most a_max dt. A differential drive turns towards the command by at most
    turn_rate dt and drives forward with the component of the command along its heading, while its speed changes by at most
    a_max dt. A command that is not finite means stop. Of the limits v_max, a_max (for braking, too), turn_rate and drive count.
    """
    v_max, gain = limits.v_max, limits.a_max * dt
    if not (math.isfinite(cx) and math.isfinite(cy)):
        cx, cy = 0.0, 0.0
    asked = math.hypot(cx, cy)
    if asked > v_max:
        cx, cy, asked = cx * (v_max / asked), cy * (v_max / asked), v_max
    if limits.drive != DIFFERENTIAL:
        dx, dy = cx - vx, cy - vy
        change = math.hypot(dx, dy)
        if change > gain:
            cx, cy = vx + dx * (gain / change), vy + dy * (gain / change)
        if math.hypot(cx, cy) > REST:
            heading = math.atan2(cy, cx)
        return cx, cy, heading
    speed = vx * math.cos(heading) + vy * math.sin(heading)
    if asked > REST:
        most = limits.turn_rate * dt
        turn = wrap(math.atan2(cy, cx) - heading)
        heading = wrap(heading + min(max(turn, -most), most))
    wanted = max(cx * math.cos(heading) + cy * math.sin(heading), 0.0)
    speed = min(max(wanted, speed - gain), speed + gain)
    return speed * math.cos(heading), speed * math.sin(heading), heading
