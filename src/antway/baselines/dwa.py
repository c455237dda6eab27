"""Policy `dwa`: the dynamic window approach, with moving obstacles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.baselines.replan import STOP, Avoider
from antway.kernels.base.records import RobotState
from antway.kernels.baselines.dwa import Obstacles, roll_out, roll_out_twists
from antway.world.nearby import contact_radii, now
from antway.world.policy import XY, Command, Observation, Task, commanded
from antway.world.terrain import terrain_of

_MOST = 1e100  # largest weight, so that no value is infinite: of several infinite ones the first would be the best


@dataclass(kw_only=True, eq=False, repr=False)
class Dwa(Avoider):
    """Choose, from the velocities that can be reached within a control period, the best one that is safe.

    Each candidate command is kept for `horizon` s within the robot's limits of speed, acceleration and turning, while all
    obstacles keep their velocities. It is admissible if the robot can still stop before the first contact. The policy takes the
    admissible command with the largest sum of `heading` (1 - angle to the target / pi, after one period), `dist` (time of the
    first contact, as a share of the horizon) and `vel` (speed / v_max). The target is the farthest visible point of the global
    path. If no command is admissible, the contact is delayed as long as possible. For wheels with ramps, candidates are the
    twists that can be reached within a period; their angle to the target is measured after `aim` s, and they are admissible
    only if braking with the same turn rate keeps clear of walls.

    Parameters
    ----------
    heading, dist : float
        Weights, in [0, 1e100].
    vel : float or None
        Weight, in [0, 1e100]; None: 1.1, or 0.25 for wheels with ramps.
    horizon : float
        s, > 0.
    look_ahead : float
        Largest distance of the target along the path, m, > 0.
    directions, speeds : int
        Number of directions, >= 3, and of speeds, >= 1, of the candidates.
    margin : float or None
        Distance kept from obstacles, m, in [0, 1e6]; None: 0.2, or 0.1 for wheels with ramps.
    turns : int
        For wheels with ramps: number of turn rates, >= 2, for each of `speeds` + 1 speeds.
    aim : float
        s, > 0.

    Notes
    -----
    Fox, Burgard, Thrun: The dynamic window approach to collision avoidance, IEEE Robotics & Automation Magazine 4(1), 1997.
    In the paper a candidate is an arc of given speed and turn rate, as here for wheels with ramps; for other robots it is a
    command. There obstacles stand still, and the weights are 2, 0.2 and 0.2, with which this robot stops before corners.
    """

    knows_inertia = True
    heading: float = 1.0
    dist: float = 2.0
    vel: float | None = None
    horizon: float = 3.0
    look_ahead: float = 2.0
    directions: int = 36
    speeds: int = 4
    margin: float | None = None
    turns: int = 11
    aim: float = 0.7

    def __post_init__(self) -> None:
        checks.fields(self, "heading", "dist", low=0.0, high=_MOST)
        checks.fields(self, "horizon", "aim", low=0.0, high=1e6, open_low=True, unit="s")
        checks.fields(self, "look_ahead", low=0.0, open_low=True, unit="m")
        for name, high, unit in (("vel", _MOST, ""), ("margin", 1e6, "m")):
            if getattr(self, name) is not None:
                checks.fields(self, name, low=0.0, high=high, unit=unit)
        self.directions = checks.integer("directions", self.directions, low=3, high=3600)
        self.speeds = checks.integer("speeds", self.speeds, low=1, high=100)
        self.turns = checks.integer("turns", self.turns, low=2, high=1000)

    def reset(self, task: Task, seed: int) -> None:
        """Prepare the candidates."""
        super().reset(task, seed)
        robot = task.robot
        angle = np.arange(self.directions) * (2 * math.pi / self.directions)
        speed = robot.v_max * np.arange(1, self.speeds + 1) / self.speeds
        self.circles = np.outer(speed, np.exp(1j * angle)).ravel()
        self.limits, self.terrain = robot.limits, terrain_of(task.grid)
        self.periods, self.aim_periods = (
            max(math.ceil(min(seconds / robot.dt, 1000.0) - 1e-9), 1) for seconds in (self.horizon, self.aim)
        )
        self.rolls = robot.wheels and not robot.stepwise
        vel, margin = (0.25, 0.1) if self.rolls else (1.1, 0.2)
        self.speed_weight = vel if self.vel is None else self.vel
        self.kept = margin if self.margin is None else self.margin
        self.turning = 0.0

    def act(self, observation: Observation) -> Command:
        """Return the command for the next control period, and remember how it turns."""
        command = super().act(observation)
        self.turning = command.acts(observation, self.task.robot)[1]
        return command

    def steer(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        o, robot = observation, self.task.robot
        # Wheels that have passed the target when its angle is measured would rather stop short of it for good.
        target = self.target(o, self.look_ahead, self.aim * robot.v_max if self.rolls else 0.0)
        if target is None:
            return STOP
        if self.rolls:
            state = o.state_at_action(robot)
            commands = self._window(state)
            ends = self._rolled(o, state, commands)
        else:
            commands = self._candidates(o, target)
            ends = self._ends(o, commands)
        free = np.minimum(ends[:, 0], self.horizon)
        admissible = free > robot.dt + np.abs(ends[:, 1]) / (2 * robot.braking)
        if self.rolls:
            clear = ends[:, 5] > 0.0
            admissible &= clear
            free = np.where(clear, free, 0.0)
        if not admissible.any():
            best = int(np.argmax(free))
            self.decide("brake", "no velocity is safe: this one delays contact longest")
            if self.rolls and not clear.any():
                commands[best] = 0.0, self.turning  # the stop that was found clear of walls with the last command
        else:
            best = int(np.argmax(np.where(admissible, self._value(o, target, ends, free), -math.inf)))
            self.decide("follow", "the best velocity in the window")
        one, two = commands[best].tolist()
        return commanded(one, two, o.heading, robot) if self.rolls else Command((one, two))

    def _candidates(self, o: Observation, target: XY) -> NDArray[np.float64]:
        """Return the candidates: rest, all directions and speeds, and straight to the target."""
        robot, dx, dy = self.task.robot, target[0] - o.xy[0], target[1] - o.xy[1]
        speed = min(robot.v_max, math.hypot(dx, dy) / robot.dt)
        there = speed * np.exp(1j * math.atan2(dy, dx))
        every = np.concatenate(([0.0], self.circles, there * np.arange(1, self.speeds + 1) / self.speeds))
        return np.column_stack((every.real, every.imag))

    def _window(self, state: RobotState) -> NDArray[np.float64]:
        """Return the twists that can be reached within a period, and those that stop."""
        robot, (v, w) = self.task.robot, state[3:]
        gain, loss, spin = robot.a_max * robot.dt, robot.braking * robot.dt, robot.alpha_max * robot.dt
        low = max(v - (loss if v > 0.0 else gain), -robot.v_reverse)
        high = min(v + (gain if v >= 0.0 else loss), robot.v_max)
        speed = np.linspace(low, max(low, high), self.speeds + 1)
        turn = np.linspace(max(w - spin, -robot.turn_rate), min(w + spin, robot.turn_rate), self.turns)
        grid = np.column_stack((np.repeat(speed, self.turns), np.tile(turn, len(speed))))
        stop = min(max(0.0, low), high)
        return np.vstack((np.column_stack((np.full(self.turns, stop), turn)), grid))

    def _rolled(self, o: Observation, state: RobotState, commands: NDArray[np.float64]) -> NDArray[np.float64]:
        ends, aim = np.empty((len(commands), 6)), self.aim_periods
        steps, obstacles = max(self.periods, aim), self._obstacles(o)
        roll_out_twists(commands, state, self.limits, self.task.robot.dt, steps, aim, self.terrain, obstacles, ends)
        return ends

    def _ends(self, o: Observation, commands: NDArray[np.float64]) -> NDArray[np.float64]:
        ends, state = np.empty((len(commands), 4)), RobotState(*o.xy, o.heading, *o.velocity)
        obstacles = self._obstacles(o)
        roll_out(commands, state, self.limits, self.task.robot.dt, self.periods, self.terrain, obstacles, ends)
        return ends

    def _obstacles(self, o: Observation) -> Obstacles:
        xy, velocity = now(o)
        return Obstacles(xy, velocity, contact_radii(o, xy, o.xy, self.task.robot, self.kept))

    def _value(self, o: Observation, target: XY, ends: NDArray[np.float64], free: NDArray[np.float64]) -> NDArray[np.float64]:
        speed, place = ends[:, 1], ends[:, 2:4]
        if self.rolls:
            direction = ends[:, 4]
        else:
            moved = place - o.xy
            direction = np.where(speed > 0.0, np.arctan2(moved[:, 1], moved[:, 0]), o.heading)
        ahead = np.subtract(target, place)
        off = np.abs((direction - np.arctan2(ahead[:, 1], ahead[:, 0]) + math.pi) % (2 * math.pi) - math.pi)
        value: NDArray[np.float64] = self.heading * (1 - off / math.pi) + self.dist * free / self.horizon
        return value + self.speed_weight * (speed / self.task.robot.v_max)
