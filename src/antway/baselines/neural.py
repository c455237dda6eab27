"""Policies `neural` and `glasius`: the robot ascends the activity that spreads from the goal over the cells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.baselines.replan import STOP, Avoider, short_of_walls
from antway.errors import OutOfBounds
from antway.grid import Cell
from antway.kernels.baselines.neural import CLOSED, DIAGONAL, FREE, TARGET, ascend, relax, shunt, stamp
from antway.world.line_of_sight import clear, diagonal_radius
from antway.world.nearby import now
from antway.world.policy import XY, Command, Decision, Observation, Task

SETTLED = 1e-6  # relative change in a sweep below which the activity is stationary
MOST = 10_000  # limit of sweeps before an episode
TRANSFERS = {"mean": DIAGONAL, "glasius": 1.0}  # weight of a diagonal neighbour


class Neural(Avoider):
    """Ascend the activity of a shunting neural network with one neuron for each cell; nothing is learnt.

    Each neuron follows dx/dt = -A x + (B - x)([I]+ + sum_j mu [x_j]+ / d_j) - (D + x)[I]-, over its 8 neighbours at distance
    d_j (diagonal ones only between two open cells). I is E at the goal, and -E in cells that are closed to the robot's centre
    by a wall or by the present place of an obstacle. Positive activity comes only from the goal, so there is no other maximum.
    The network is stationary on the empty map at the start of an episode; in each cycle `sweeps` times `span` s pass.

    Known faults: activity decreases by a factor of 5 to 15 per cell, so that after about 270 cells of a corridor it underflows
    and the robot is stuck. The robot avoids obstacles where they are, not where they will be.

    Parameters
    ----------
    decay, upper, lower, mu, drive : float
        A > 0, B > 0, D >= 0, 0 < mu <= A / 8 and E > 0.
    sweeps : int
        Number of updates of the network in a cycle, >= 1.
    span : float
        s, > 0, may be infinite.
    margin : float
        Distance kept from obstacles, m, >= 0.

    Notes
    -----
    Yang, Meng: An efficient neural network approach to dynamic robot motion planning, Neural Networks 13, 2000. Yang, Meng:
    Neural network approaches to dynamic collision-free trajectory generation, IEEE Trans. SMC B 31(3), 2001.
    """

    def __init__(
        self,
        *,
        decay: float = 10.0,
        upper: float = 1.0,
        lower: float = 1.0,
        mu: float = 0.7,
        drive: float = 100.0,
        sweeps: int = 12,
        span: float = 0.1,
        margin: float = 0.1,
    ) -> None:
        self.decay = checks.number("decay", decay, low=0.0, open_low=True)
        self.upper = checks.number("upper", upper, low=0.0, open_low=True)
        self.lower = checks.number("lower", lower, low=0.0)
        self.mu = checks.number("mu", mu, low=0.0, high=self.decay / 8, open_low=True)
        self.drive = checks.number("drive", drive, low=0.0, open_low=True)
        self.span = checks.number("span", span, low=0.0, open_low=True, infinite=True, unit="s")
        self._common(sweeps, margin)

    def _common(self, sweeps: int, margin: float) -> None:
        self.sweeps = checks.integer("sweeps", sweeps, low=1)
        self.margin = checks.number("margin", margin, low=0.0, unit="m")

    def reset(self, task: Task, seed: int) -> None:
        """Compute the stationary activity on the empty map."""
        checks.instance("task", task, Task)
        checks.seed(seed)
        self.task, grid, size = task, task.grid, task.grid.resolution
        self.kept = self.margin + size
        closed = grid.inflate(diagonal_radius(task)).blocked
        self.walls = np.pad(np.where(closed, CLOSED, FREE).astype(np.uint8), 1, constant_values=CLOSED)
        self.goal = self._cell(task.goal)
        self.walls[self.goal] = TARGET
        self.frame = np.array([grid.origin[0] - size, grid.origin[1] - size, size])
        self.x, self.order = np.zeros(self.walls.shape), 0
        self.steps = math.ceil(task.robot.v_max * task.robot.dt / size) + 1
        self.turning = 0.0
        self.decision = Decision("follow", "up the activity")
        for _ in range(MOST):
            if self._sweep(self.walls, rest=True) < SETTLED:
                break

    def _sweep(self, kind: NDArray[np.uint8], rest: bool = False) -> float:
        self.order += 1
        span = math.inf if rest else self.span
        return shunt(self.x, kind, self.decay, self.upper, self.lower, self.mu, self.drive, span, self.order & 3)

    def steer(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        o, task = observation, self.task
        kind = self.walls.copy()
        stamp(kind, self.frame, now(o)[0], o.tracks.radius + task.robot.radius + self.margin)
        for _ in range(self.sweeps):
            self._sweep(kind)
        target = self._up(o, kind)
        if target is None:
            self.decide("stuck", "no neighbouring cell is more active")
            return STOP
        self.decide("follow", "up the activity")
        dt = task.robot.dt
        return short_of_walls(task, o, (target[0] - o.xy[0]) / dt, (target[1] - o.xy[1]) / dt)

    def _cell(self, xy: XY) -> Cell:
        """Return the cell that contains a point, with indices that include the rim."""
        row, col = self.task.grid.cell_at(xy)
        return row + 1, col + 1

    def _up(self, o: Observation, kind: NDArray[np.uint8]) -> XY | None:
        """Return the farthest visible place on the ascending path, about one control period away."""
        try:
            here = self._cell(o.xy)
        except OutOfBounds:  # the robot's place is wrong
            return None
        if here == self.goal:
            return self.task.goal
        for cell in ascend(self.x, kind, *here, self.steps)[::-1].tolist():
            place = self.task.goal if tuple(cell) == self.goal else self.task.grid.centre((cell[0] - 1, cell[1] - 1))
            if clear(self.task, o.xy, place):
                return place
        return None


class Glasius(Neural):
    """Ascend the activity of a bounded relaxation: 1 at the goal, 0 in closed cells, else below the neighbours' mean.

    With `transfer` "mean" each cell becomes `gain` times the mean of its 8 neighbours, weighted by 1 / distance: activity falls
    by a third per cell in open space, and by a factor of 7 in a corridor one cell wide. With "glasius" it becomes g of the
    plain sum of its 8 neighbours, where g(x) = 0 for x < 0, `gain` x / 8 up to 1, then 1; diagonal neighbours count as much as
    straight ones. Everything else is as in `Neural`.

    Parameters
    ----------
    gain : float
        In (0, 1).
    transfer : str
        "mean" or "glasius".
    sweeps, margin
        As in `Neural`.

    Notes
    -----
    Glasius, Komoda, Gielen: Neural network dynamics for path planning and obstacle avoidance, Neural Networks 8(1), 1995. Their
    g has some slope beta; any below 1 / 8, the number of neighbours, has one state of rest, and keeps all but the goal below 1.
    """

    def __init__(self, *, gain: float = 0.95, transfer: str = "mean", sweeps: int = 8, margin: float = 0.1) -> None:
        self.gain = checks.number("gain", gain, low=0.0, high=1 - 1e-6, open_low=True)
        self.transfer = checks.choice("transfer", transfer, TRANSFERS)
        self._common(sweeps, margin)

    def _sweep(self, kind: NDArray[np.uint8], rest: bool = False) -> float:
        self.order += 1
        diagonal = TRANSFERS[self.transfer]
        return relax(self.x, kind, self.gain / (4.0 + 4.0 * diagonal), diagonal, self.order & 3)
