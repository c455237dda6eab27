"""Policies `orca` and `nh-orca`: optimal reciprocal collision avoidance by RVO2, and a variant for wheels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from antway import checks
from antway.baselines.replan import STOP, Avoider
from antway.errors import BadParameter
from antway.grid import Grid
from antway.world.nearby import now
from antway.world.policy import XY, Command, Observation, Task, commanded

AWAY = 1e6  # m; place of unused agents, and limit of margins: with larger ones RVO2, in single precision, returns no numbers


class Orca(Avoider):
    """Take the velocity nearest to the preferred one that avoids all agents for some time if they do their half.

    The preferred velocity leads to the farthest visible point of the global path, at full speed or, within the last metre,
    slower in proportion to the remaining distance. Walls are obstacles of RVO2. Each track is an agent without a goal at its
    present velocity. The method assumes that obstacles avoid the robot; if they do not, they may hit it.

    Parameters
    ----------
    horizon, wall_horizon : float
        For how long the velocity must be free of moving obstacles, and of walls, s, > 0.
    margin : float
        Added to every radius, m, in [0, 1e6].
    look_ahead : float
        Largest distance of the target along the path, m, > 0.

    Raises
    ------
    BadParameter
        If pyrvo is not installed.

    Notes
    -----
    Van den Berg, Guy, Lin, Manocha: Reciprocal n-body collision avoidance, ISRR 2011. Horizon, margin and preferred velocity
    are those of Chen, Liu, Kreiss, Alahi: Crowd-robot interaction, ICRA 2019.
    """

    name = "orca"
    error = 0.0  # m; enlargement of the robot's radius

    def __init__(
        self, *, horizon: float = 5.0, wall_horizon: float = 0.5, margin: float = 0.01, look_ahead: float = 2.0
    ) -> None:
        self.horizon = checks.number("horizon", horizon, low=0.0, open_low=True, unit="s")
        self.wall_horizon = checks.number("wall_horizon", wall_horizon, low=0.0, open_low=True, unit="s")
        self.margin = checks.number("margin", margin, low=0.0, high=AWAY, unit="m")
        self.look_ahead = checks.number("look_ahead", look_ahead, low=0.0, open_low=True, unit="m")
        try:
            from pyrvo import RVOSimulator
        except ImportError:
            raise BadParameter("policy", self.name, "another, or install pyrvo (the extra `arena`)") from None
        self.simulator = RVOSimulator

    def reset(self, task: Task, seed: int) -> None:
        """Set up the simulation: the robot and the walls."""
        super().reset(task, seed)
        robot, self.kept = task.robot, 2.0 * self.margin + self.error
        self.simulation: Any = self.simulator(
            robot.dt, 10.0, 10, self.horizon, self.wall_horizon, robot.radius + self.margin, robot.v_max
        )
        for polygon in outlines(task.grid):
            self.simulation.add_obstacle(polygon)
        self.simulation.process_obstacles()
        self.simulation.add_agent(task.start)

    def steer(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        o, robot, simulation = observation, self.task.robot, self.simulation
        target = self.target(o, self.look_ahead)
        if target is None:
            return STOP
        dx, dy = target[0] - o.xy[0], target[1] - o.xy[1]
        distance = max(math.hypot(dx, dy), 1.0 if target == self.task.goal else 1e-9)
        preferred = dx * robot.v_max / distance, dy * robot.v_max / distance
        self._place(0, o.xy, o.velocity, robot.radius, preferred)
        xy, velocity = now(o)
        for k in range(max(len(o.tracks), simulation.get_num_agents() - 1)):
            if k + 1 == simulation.get_num_agents():
                simulation.add_agent((AWAY, AWAY))
            if k < len(o.tracks):
                (x, y), (vx, vy) = xy[k].tolist(), velocity[k].tolist()
                self._place(k + 1, (x, y), (vx, vy), float(o.tracks.radius[k]), (0.0, 0.0))
            else:
                simulation.set_agent_position(k + 1, (AWAY, AWAY + AWAY * k))
        simulation.do_step()
        found = simulation.get_agent_velocity(0)
        if math.dist((found.x, found.y), preferred) < 1e-3:
            self.decide("follow", "the preferred velocity is free")
        else:
            self.decide("avoid", "the nearest velocity that does the robot's half of the avoidance")
        return Command((float(found.x), float(found.y)))

    def _place(self, k: int, xy: XY, velocity: XY, radius: float, preferred: XY) -> None:
        self.simulation.set_agent_position(k, xy)
        self.simulation.set_agent_velocity(k, velocity)
        self.simulation.set_agent_radius(k, radius + self.margin + (self.error if k == 0 else 0.0))
        self.simulation.set_agent_pref_velocity(k, preferred)


class NhOrca(Orca):
    """Do as `orca` with an enlarged robot, and track the velocity with wheels, with an error up to the enlargement.

    Within T s wheels turn to the direction of the velocity at a constant turn rate. Their deviation grows with the angle and
    the speed, so the speed is limited to keep it within `error`. T is the shortest time that the limit of the turn rate allows.

    Parameters
    ----------
    error : float
        Enlargement of the robot's radius, m, in (0, 1e6].
    turn_time : float
        Least T, s, > 0.
    horizon, wall_horizon, margin, look_ahead : float
        As in `orca`.

    Notes
    -----
    Alonso-Mora, Breitenmoser, Rufli, Beardsley, Siegwart: Optimal reciprocal collision avoidance for multiple non-holonomic
    robots, DARS 2010, eqs. 3 to 7; the velocity of the linear program is slowed down to be in the set of allowed ones.
    """

    name = "nh-orca"
    knows_inertia = True

    def __init__(
        self,
        *,
        error: float = 0.05,
        turn_time: float = 0.35,
        horizon: float = 2.0,
        wall_horizon: float = 2.0,
        margin: float = 0.01,
        look_ahead: float = 2.0,
    ) -> None:
        self.error = checks.number("error", error, low=0.0, high=AWAY, open_low=True, unit="m")
        self.turn_time = checks.number("turn_time", turn_time, low=0.0, open_low=True, unit="s")
        super().__init__(horizon=horizon, wall_horizon=wall_horizon, margin=margin, look_ahead=look_ahead)

    def steer(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        command, robot = super().steer(observation), self.task.robot
        speed = math.hypot(*command.velocity)
        if not robot.wheels or speed < 1e-6:
            return command
        angle = math.remainder(math.atan2(command.velocity[1], command.velocity[0]) - observation.heading, 2.0 * math.pi)
        v, omega = tracked(speed, angle, max(self.turn_time, abs(angle) / robot.turn_rate), self.error)
        return commanded(min(v, robot.v_max), omega, observation.heading, robot)


def tracked(speed: float, angle: float, time: float, error: float) -> XY:
    """Return the twist (v, omega) of wheels that track a velocity of `speed` m/s, `angle` rad off their heading, in `time` s.

    With c = 2 (1 - cos angle): v = speed angle sin(angle) / c, and the error of the place is
    time speed sqrt(1 - sin^2(angle) / c), which lower speeds keep within `error` m.

    Examples
    --------
    >>> tracked(1.0, 0.0, 0.5, 0.1)
    (1.0, 0.0)
    """
    c = 2.0 * (1.0 - math.cos(angle))
    if c < 1e-12:
        return speed, 0.0
    off = time * math.sqrt(max(1.0 - math.sin(angle) ** 2 / c, 0.0))
    speed = min(speed, error / off) if off > 0.0 else speed
    return speed * angle * math.sin(angle) / c, angle / time


def outlines(grid: Grid) -> list[list[XY]]:
    """Return the blocked cells as disjoint counterclockwise rectangles, and the map's edge clockwise; m."""
    rows, cols = grid.shape
    taken = ~grid.blocked
    boxes = [(rows, 0, 0, cols)]  # the edge, turned inside out
    for row, col in np.argwhere(grid.blocked).tolist():
        if taken[row, col]:
            continue
        right = col + 1
        while right < cols and not taken[row, right]:
            right += 1
        top = row + 1
        while top < rows and not taken[top, col:right].any():
            top += 1
        taken[row:top, col:right] = True
        boxes.append((row, col, top, right))
    (x, y, _), s = grid.origin, grid.resolution
    return [
        [(x + c * s, y + r * s) for r, c in ((low, left), (low, right), (high, right), (high, left))]
        for low, left, high, right in boxes
    ]
