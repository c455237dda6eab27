"""Model predictive path integral control: the mean of many noisy copies of one sequence of controls, weighted by cost."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.base.rng import State
from antway.kernels.controls.colony import normal
from antway.kernels.controls.rollout import CostWeights, Outlook, StaticField, judge


class Sampling(NamedTuple):
    """How samples are drawn and weighted, and scratch for them."""

    block: int  # number of steps that share a draw
    spread_a: float  # standard deviation of the speed, or of the velocity's x and y, m/s
    spread_b: float  # standard deviation of the turn rate, rad/s, or of the velocity's x and y, m/s
    temperature: float  # s
    drawn: NDArray[np.float64]  # [K, S, 2]
    cost: NDArray[np.float64]  # [K] s


@kernel
def path_integral(
    nominal: NDArray[np.float64],
    sampling: Sampling,
    start: NDArray[np.float64],
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    outlook: Outlook,
    weights: CostWeights,
    state: State,
) -> None:
    """Replace `nominal`, float64[S, 2], by the mean of its noisy copies, each with the weight exp(-cost / temperature).

    One copy is without noise and one is a stop. The other parameters are those of `forage` in kernels/controls/colony.py.
    """
    count, steps = sampling.drawn.shape[0], len(nominal)
    holonomic = limits.drive == HOLONOMIC
    slowest = -limits.v_max if holonomic else -limits.v_reverse
    turn = limits.v_max if holonomic else limits.turn_rate
    nothing = np.empty((0, 2))
    least = math.inf
    for i in range(count):
        da, db = 0.0, 0.0
        one = sampling.drawn[i]
        for k in range(steps):
            if k % sampling.block == 0 and i > 1:
                da, db = normal(state) * sampling.spread_a, normal(state) * sampling.spread_b
            one[k, 0] = min(max(nominal[k, 0] + da, slowest), limits.v_max) if i != 1 else 0.0
            one[k, 1] = min(max(nominal[k, 1] + db, -turn), turn) if i != 1 else 0.0
        sampling.cost[i] = judge(one, start, limits, dt, field, outlook, weights, math.inf, nothing)
        least = min(least, sampling.cost[i])
    nominal[:] = 0.0
    total = 0.0
    for i in range(count):
        weight = math.exp(-(sampling.cost[i] - least) / sampling.temperature)
        if weight > 1e-12:
            total += weight
            for k in range(steps):
                nominal[k, 0] += weight * sampling.drawn[i, k, 0]
                nominal[k, 1] += weight * sampling.drawn[i, k, 1]
    nominal /= total
