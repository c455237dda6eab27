"""Optimizers that the ants in the space of controls are compared with; they use the same rollouts, and as many of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import kernel
from antway.kernels.base.rng import State, below
from antway.kernels.base.rows import copy_rows
from antway.kernels.controls.abreast import judge_all
from antway.kernels.controls.colony import Archive, ControlColonySettings, insert, refill, vary
from antway.kernels.controls.lattice import ControlLattice
from antway.kernels.controls.problem import ControlProblem


class Averaging(NamedTuple):
    """How the mean of a round's sequences is computed, and memory for it."""

    elite: int  # this many best sequences have equal weight (cross-entropy method); 0: weights exp(-cost / temperature) (MPPI)
    temperature: float  # s
    mean: Floats  # [S, 2]
    spread: Floats  # [B, 2] standard deviation of a draw, by block


@kernel
def _average_of_round(averaging: Averaging, drawn: Floats, cost: Floats, block: int, least: tuple[float, float]) -> None:
    """Compute the mean of the sequences drawn, and in the cross-entropy method their spread, which is at least `least`."""
    mean, spread = averaging.mean, averaging.spread
    order, share = np.argsort(cost), np.zeros(len(cost))
    elite = order[: averaging.elite]
    if averaging.elite > 0:
        share[elite] = 1.0
    else:
        for i in range(len(cost)):
            share[i] = math.exp(-(cost[i] - cost[order[0]]) / averaging.temperature)
    share /= share.sum()
    mean[:] = 0.0
    for i in range(len(cost)):
        if share[i] > 1e-12:
            mean += share[i] * drawn[i]
    if averaging.elite > 0:
        for b in range(len(spread)):
            k = min(b * block + block // 2, len(mean) - 1)
            for j in range(2):
                square = 0.0
                for i in elite:
                    square += (drawn[i, k, j] - mean[k, j]) ** 2
                spread[b, j] = max(math.sqrt(square / len(elite)), least[j])


@kernel
def average(
    archive: Archive,
    lattice: ControlLattice,
    colony: ControlColonySettings,
    problem: ControlProblem,
    state: State,
    averaging: Averaging,
) -> None:
    """Do as `forage`, but keep only a mean: each round draws sequences around it and averages them.

    The first mean is the best of the seeds and the last mean. With `averaging.elite` = 0 this is MPPI (Williams and others
    2018). Otherwise it is the cross-entropy method (Rubinstein and Kroese 2004), which draws with the spread of the elite.
    """
    mean, spread, block = averaging.mean, averaging.spread, archive.block
    drawn, cost = archive.ants[: colony.ants], archive.ant_cost[: colony.ants]
    refill(archive, lattice, problem, 1)
    copy_rows(archive.sequence[archive.order[0]], mean)
    spread[:, 0], spread[:, 1] = colony.wide
    for _ in range(colony.rounds):
        for i in range(colony.ants):
            if i == 0:
                copy_rows(mean, drawn[i])
            else:
                vary(drawn[i], mean, spread, 1.0, (0.0, 0.0), block, problem.limits, state)
        judge_all(drawn, problem, math.inf, cost)
        _average_of_round(averaging, drawn, cost, block, colony.least)
    archive.used[0] = 0
    copy_rows(mean, archive.ants[colony.ants])
    judge_all(archive.ants[colony.ants : colony.ants + 1], problem, math.inf, archive.ant_cost[colony.ants :])
    insert(archive, colony.ants)


@kernel
def restart(
    archive: Archive,
    lattice: ControlLattice,
    colony: ControlColonySettings,
    problem: ControlProblem,
    state: State,
    averaging: Averaging,
) -> None:
    """Do as `forage`, but without an archive: each sequence is drawn around a random seed, and the best of all is kept."""
    spread = averaging.spread
    refill(archive, lattice, problem, 1)
    spread[:, 0], spread[:, 1] = colony.wide
    best, cost = archive.cost[archive.order[0]], archive.ant_cost[: colony.ants]
    copy_rows(archive.sequence[archive.order[0]], averaging.mean)
    for _ in range(colony.rounds):
        for i in range(colony.ants):
            guide = archive.sequence[archive.order[below(state, archive.used[0])]]
            vary(archive.ants[i], guide, spread, 1.0, (0.0, 0.0), archive.block, problem.limits, state)
        judge_all(archive.ants[: colony.ants], problem, best, cost)
        if cost.min() < best:
            best = cost.min()
            copy_rows(archive.ants[cost.argmin()], averaging.mean)
    archive.used[0] = 0
    cost[0] = best
    copy_rows(averaging.mean, archive.ants[0])
    insert(archive, 0)
