"""Pheromone on edges, the same for every graph: tau[n, k] lies on the k candidate edges that leave each of n nodes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel

CONSTANT, ADAPTIVE, PRINTED, DECAY, BY_QUALITY = range(5)  # kinds of persistence, see `antway.ants.persistence`
FLOOR = 1e-150  # least pheromone of an edge that no ant takes, so that it is always > 0
CEILING = 1e150  # largest amount of a deposit and largest initial pheromone, so that sums and products of them are finite
_NO_SCHEDULE = np.empty((0, 2), dtype=np.int64)


class Numbers(NamedTuple):
    """A colony's rule as kernels use it. All rules have the same fields; unused ones are 0 or empty."""

    alpha: float  # exponent of pheromone, Eq. (1)
    beta: float  # exponent of the heuristic, Eq. (1)
    q: float  # Q of the deposit Q / L_k, Eq. (2)
    persistence_rule: NDArray[np.float64]  # [4] kind of persistence, and its parameters
    deposit_weight: NDArray[np.float64]  # [ants] the r-th best ant of a cycle deposits this times Q / L_r
    elite: float = 0.0  # in every cycle the best so far deposits this times Q / L_best
    # [s, 2] MMAS: from which cycle on, and every how many cycles, the best so far deposits in place of the ants
    schedule: NDArray[np.int64] = _NO_SCHEDULE
    p_best: float = 0.0  # MMAS: probability that determines the limits of pheromone; 0: no limits
    choices: float = 0.0  # MMAS: average number of alternatives at a step; 0: that of the problem
    restart: int = 0  # MMAS: number of cycles without improvement after which pheromone is reset; 0: never
    q0: float = 0.0  # ACS: probability of taking the edge of largest weight
    xi: float = 0.0  # ACS: share of tau_0 in the local update
    best_only: bool = False  # ACS: whether only the edges of the best so far evaporate


@kernel
def persistence(persistence_rule: NDArray[np.float64], tau: float, tau_min: float, t: int, excess: float) -> float:
    """Return rho after `t` cycles at pheromone `tau`; tau_min is the least of all edges, excess L_cycle / L_best - 1 >= 0."""
    kind = persistence_rule[0]
    a, b, c = float(persistence_rule[1]), float(persistence_rule[2]), float(persistence_rule[3])
    if kind == CONSTANT:
        return a
    if kind == ADAPTIVE:
        return min(max(math.exp(-tau_min / tau) + math.exp(-t), a), b)
    if kind == PRINTED:
        return math.exp(tau_min / tau) + math.exp(-t)
    if kind == DECAY:
        return max(c, a * math.pow(b, t))
    return a + (b - a) * math.exp(-excess / c)


@kernel
def evaporate(tau: NDArray[np.float64], persistence_rule: NDArray[np.float64], t: int, excess: float) -> None:
    """Let the pheromone on all edges, float64[n, k], evaporate: tau becomes max(rho tau, FLOOR), with rho by `persistence`."""
    flat = tau.reshape(tau.size)
    if persistence_rule[0] == ADAPTIVE or persistence_rule[0] == PRINTED:
        tau_min = flat.min()
        for e in range(flat.size):
            flat[e] = max(flat[e] * persistence(persistence_rule, flat[e], tau_min, t, excess), FLOOR)
    else:
        rho = persistence(persistence_rule, 1.0, 1.0, t, excess)
        for e in range(flat.size):
            flat[e] = max(flat[e] * rho, FLOOR)


@kernel
def limits(numbers: Numbers, rho: float, best: float, nodes: int, choices: float) -> tuple[float, float]:
    """Return MMAS's (tau_min, tau_max) for a best length > 0 in `nodes` steps of `choices` alternatives on average.

    rho is the persistence of the strongest edge; an evaporation below 1/1000 counts as 1/1000.
    tau_max = Q / ((1 - rho) best), tau_min = tau_max (1 - p) / ((choices - 1) p) with p = p_best ** (1 / nodes)
    (Stuetzle, Hoos 2000), and both are at most CEILING.
    """
    tau_max = min(numbers.q / (max(1.0 - rho, 1e-3) * best), CEILING)
    p = numbers.p_best ** (1.0 / nodes)
    return min(tau_max, tau_max * (1.0 - p) / (max(choices - 1.0, 1e-9) * p)), tau_max


@kernel
def best_deposits(schedule: NDArray[np.int64], cycle: int) -> bool:
    """Tell whether the best so far of MMAS deposits in this cycle, counted from 0 at the last restart."""
    every = 0
    for row in range(len(schedule)):
        if cycle >= schedule[row, 0]:
            every = schedule[row, 1]
    return every > 0 and (cycle + 1) % every == 0


@kernel
def clip(tau: NDArray[np.float64], low: float, high: float) -> None:
    """Keep pheromone within [low, high] (tau: [n, k], in place)."""
    flat = tau.reshape(tau.size)
    for e in range(flat.size):
        flat[e] = min(max(flat[e], low), high)
