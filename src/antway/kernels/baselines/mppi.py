"""Model predictive path integral control: the mean of many noisy copies of one sequence of controls, weighted by cost."""

from __future__ import annotations

import math
from typing import NamedTuple

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import kernel
from antway.kernels.base.rng import State
from antway.kernels.controls.abreast import judge_all
from antway.kernels.controls.colony import nearly_normal
from antway.kernels.controls.motion import within_limits
from antway.kernels.controls.problem import ControlProblem


class Sampling(NamedTuple):
    """How samples are drawn and weighted, and scratch for them."""

    block: int  # number of steps that share a draw
    spread_a: float  # standard deviation of the speed, or of the velocity's x and y, m/s
    spread_b: float  # standard deviation of the turn rate, rad/s, or of the velocity's x and y, m/s
    temperature: float  # s
    drawn: Floats  # [K, S, 2]
    cost: Floats  # [K] s


@kernel
def path_integral(nominal: Floats, sampling: Sampling, problem: ControlProblem, state: State) -> None:
    """Replace `nominal`, float64[S, 2], by the mean of its noisy copies, each with the weight exp(-cost / temperature).

    One copy is without noise and one is a stop.
    """
    count, steps = sampling.drawn.shape[0], len(nominal)
    for i in range(count):
        da, db = 0.0, 0.0
        one = sampling.drawn[i]
        for k in range(steps):
            if k % sampling.block == 0 and i > 1:
                da, db = nearly_normal(state) * sampling.spread_a, nearly_normal(state) * sampling.spread_b
            one[k, 0], one[k, 1] = within_limits(nominal[k, 0] + da, nominal[k, 1] + db, problem.limits)
        if i == 1:
            one[:] = 0.0
    judge_all(sampling.drawn, problem, math.inf, sampling.cost)
    least = sampling.cost.min()
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
