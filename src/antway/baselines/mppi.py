"""Policy `mppi`: model predictive path integral control on the robot's own dynamics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from antway import checks
from antway.baselines.replan import STOP, Avoider
from antway.kernels.base.jit import call
from antway.kernels.base.rng import make_state
from antway.kernels.baselines.mppi import Sampling, path_integral
from antway.kernels.controls.outlook import Margins, SpeedBounds, look_ahead
from antway.kernels.controls.problem import CostWeights
from antway.world.nearby import now
from antway.world.policy import Command, Observation, Task, commanded
from antway.world.rollouts import control_problem, make_batch


@dataclass(kw_only=True, eq=False, repr=False)
class Mppi(Avoider):
    """Drive the mean of many noisy sequences of controls, weighted by their costs.

    Each sequence is rolled out with the robot's dynamics (ramps, arcs, latency) among obstacles that keep their velocities. Its
    cost is made of time to the goal, contacts, closeness and walls, as for the colony of policy `antway`. The paper's
    term for the cost of controls, temperature u^T Sigma^-1 v, is left out: only where a sequence leads is weighed.

    Parameters
    ----------
    samples : int
        Number of sequences in a cycle, 3 to 100,000.
    horizon, block : float
        Length of a sequence, and of its parts with one draw each, s, > 0.
    temperature : float
        Temperature of the weights exp(-cost / temperature), s, > 0.
    speed_noise, turn_noise : float
        Standard deviations, as shares of the robot's limits, > 0.
    margin, preferred_gap : float
        Distance kept from obstacles, and preferred distance beyond that, m, in [0, 1e6].
    wall_margin : float
        Distance kept from walls, m, in [0, 1e6].

    Notes
    -----
    Williams, Drews, Goldfain, Rehg, Theodorou: Information-theoretic model predictive control, IEEE T-RO 34(6), 2018.
    """

    knows_inertia = True
    samples: int = 1000
    horizon: float = 3.0
    block: float = 0.5
    temperature: float = 0.1
    speed_noise: float = 0.35
    turn_noise: float = 0.4
    margin: float = 0.12
    preferred_gap: float = 0.2
    wall_margin: float = 0.05

    def __post_init__(self) -> None:
        self.samples = checks.integer("samples", self.samples, low=3, high=100_000)
        checks.fields(self, "horizon", "block", "temperature", low=0.0, high=1e6, open_low=True, unit="s")
        checks.fields(self, "speed_noise", "turn_noise", low=0.0, open_low=True)
        checks.fields(self, "margin", "preferred_gap", "wall_margin", low=0.0, high=1e6, unit="m")

    def reset(self, task: Task, seed: int) -> None:
        """Prepare the fields of the map and the arrays of samples."""
        super().reset(task, seed)
        robot = task.robot
        steps = max(math.ceil(min(self.horizon / robot.dt, 1000.0) - 1e-9), 2)
        turn = robot.turn_rate if robot.wheels else robot.v_max
        self.sampling = Sampling(
            max(round(self.block / robot.dt), 1),
            self.speed_noise * robot.v_max,
            self.turn_noise * min(turn, 10.0),
            self.temperature,
            np.zeros((self.samples, steps, 2)),
            np.zeros(self.samples),
        )
        nothing = CostWeights(**dict.fromkeys(CostWeights._fields, 0.0))
        weights = nothing._replace(
            progress=0.02,
            contact=30.0,
            decay=0.3,
            near=0.2,
            wall=100.0,
            wall_margin=self.wall_margin,
            ramps=1.0,
            swerve=math.inf,
        )
        self.problem = control_problem(task, self.search.field, steps, weights, make_batch(0.0, summed=True))
        self.kept = self.margin - task.goal_tolerance  # sequences end anywhere within it
        self.margins = Margins(self.margin, self.preferred_gap, 0.0, 0.0, 0.0, 0.0, 1.0)
        self.bounds = SpeedBounds(robot.v_max, 0.0, 0.0, 0.0)
        self.nominal = np.zeros((steps, 2))
        self.random = make_state(seed, 2)

    def steer(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        o, robot = observation, self.task.robot
        if not len(self.found(o).t):
            return STOP
        start = o.state_at_action(robot)
        self.problem = self.problem._replace(start=start)
        xy, velocity = now(o)
        segments = np.zeros((len(xy), 8))
        segments[:, 0], segments[:, 1] = o.t, math.inf
        segments[:, 2:4], segments[:, 4:6] = xy, velocity
        segments[:, 6] = o.tracks.radius + robot.radius
        sigma = np.zeros((len(xy), 2))
        outlook = self.problem.outlook
        call(look_ahead, segments, sigma, o.t, robot.dt, start, self.bounds, self.margins, 0.0, outlook)
        self.nominal[:-1] = self.nominal[1:]
        call(path_integral, self.nominal, self.sampling, self.problem, self.random)
        self.decide("follow", "the weighted mean of the sampled sequences")
        one, two = self.nominal[0].tolist()
        # Without wheels, vx and vy are limited apart, so both together can be too fast; rollouts and the robot slow them down.
        over = 1.0 if robot.wheels else max(math.hypot(one, two) / robot.v_max, 1.0)
        return commanded(one / over, two / over, o.heading, robot)
