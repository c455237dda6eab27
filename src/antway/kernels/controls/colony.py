"""Ants in the space of controls (ACO_R): the pheromone is an archive of good sequences, shifted from cycle to cycle.

Socha and Dorigo: Ant colony optimization for continuous domains, European Journal of Operational Research 185, 2008.
An ant picks a guide from the archive by rank. It draws its own sequence around the guide with the spread of the archive.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.records import RobotLimits
from antway.kernels.base.rng import State, next_bits, uniform
from antway.kernels.base.rows import copy_rows
from antway.kernels.controls.abreast import judge_all
from antway.kernels.controls.lattice import ControlLattice, best_arcs
from antway.kernels.controls.motion import within_limits
from antway.kernels.controls.problem import ControlProblem
from antway.kernels.controls.seeds import SEEDS, descend, write_seed

_UNKNOWN = -1.0  # first entry of a spread that has not been computed in this round


class Archive(NamedTuple):
    """Sequences of controls in fixed slots, and their order by cost."""

    sequence: Floats  # [K, S, 2]
    cost: Floats  # [K] s
    order: Ints  # [K] slots, best first
    spread: Floats  # [K, B, 2] mean distance of a sequence to the others, by block
    used: Ints  # [1] number of slots in use
    ants: Floats  # [N, S, 2] sequences that are drawn and judged abreast
    ant_cost: Floats  # [N] s
    block: int  # number of steps that share a draw


class ControlColonySettings(NamedTuple):
    """Numbers of the colony. Pairs are of the two controls: m/s and rad/s on wheels, else m/s twice."""

    rounds: int
    ants: int  # in a round
    locality: float  # q of ACO_R; a guide is picked with the weight exp(-rank^2 / (2 q^2 K^2))
    xi: float  # of ACO_R; standard deviation of a draw as a multiple of the archive's spread
    least: tuple[float, float]  # least standard deviations of a draw
    exploration: float  # share of ants whose least standard deviations are `wide`
    wide: tuple[float, float]


@inner_kernel
def nearly_normal(state: State) -> float:
    """Return a nearly normal number (mean 0, variance 1): the scaled sum of four uniform numbers from one draw of 64 bits."""
    bits = next_bits(state)
    total = (
        float(bits & np.uint64(0xFFFF))
        + float((bits >> np.uint64(16)) & np.uint64(0xFFFF))
        + float((bits >> np.uint64(32)) & np.uint64(0xFFFF))
        + float(bits >> np.uint64(48))
    )
    return (total * (1.0 / 65536.0) - 1.999969482421875) * 1.7320508075688772


@inner_kernel
def _spread(archive: Archive, place: int) -> None:
    """Compute the mean distance of a sequence to the others, block by block."""
    n = archive.used[0]
    mine = archive.sequence[place]
    for b in range(archive.spread.shape[1]):
        k = min(b * archive.block + archive.block // 2, len(mine) - 1)
        da, db = 0.0, 0.0
        for i in range(n):
            other = archive.sequence[archive.order[i]]
            da += abs(other[k, 0] - mine[k, 0])
            db += abs(other[k, 1] - mine[k, 1])
        archive.spread[place, b, 0], archive.spread[place, b, 1] = da / max(n - 1, 1), db / max(n - 1, 1)


@inner_kernel
def insert(archive: Archive, ant: int) -> None:
    """Insert an ant if the archive has space or the ant is better than the worst."""
    n, most, cost, drawn = archive.used[0], len(archive.cost), archive.ant_cost[ant], archive.ants[ant]
    if n == most:
        if cost >= archive.cost[archive.order[n - 1]]:
            return
        n -= 1
        place = archive.order[n]
    else:
        place = n
    i = n
    while i > 0 and archive.cost[archive.order[i - 1]] > cost:
        archive.order[i] = archive.order[i - 1]
        i -= 1
    archive.order[i] = place
    archive.cost[place] = cost
    for k in range(len(drawn)):
        archive.sequence[place, k, 0], archive.sequence[place, k, 1] = drawn[k, 0], drawn[k, 1]
    archive.used[0] = n + 1


@inner_kernel
def worst(archive: Archive) -> float:
    """Return the cost below which an ant is inserted, s."""
    n = archive.used[0]
    return float(archive.cost[archive.order[n - 1]]) if n == len(archive.cost) else math.inf


@kernel
def shift(archive: Archive) -> None:
    """Shift all sequences by one step; the last control is repeated."""
    for p in range(archive.used[0]):
        q = archive.sequence[p]
        for k in range(len(q) - 1):
            q[k, 0], q[k, 1] = q[k + 1, 0], q[k + 1, 1]


@inner_kernel
def vary(
    out: Floats,
    guide: Floats,
    deviation: Floats,
    factor: float,
    least: tuple[float, float],
    block: int,
    limits: RobotLimits,
    state: State,
) -> None:
    """Draw a sequence around a guide within the robot's limits, with one normal number for each block and control.

    The standard deviation is `factor` times `deviation`, float64[B, 2], and at least `least`.
    """
    for b in range(len(deviation)):
        da = nearly_normal(state) * max(factor * deviation[b, 0], least[0])
        db = nearly_normal(state) * max(factor * deviation[b, 1], least[1])
        for k in range(b * block, min((b + 1) * block, len(out))):
            out[k, 0], out[k, 1] = within_limits(guide[k, 0] + da, guide[k, 1] + db, limits)


@inner_kernel
def draw(archive: Archive, ant: int, colony: ControlColonySettings, limits: RobotLimits, state: State) -> None:
    """Draw one ant around a guide that is picked by rank."""
    n = archive.used[0]
    rank = n
    while rank >= n:
        rank = int(abs(nearly_normal(state)) * colony.locality * len(archive.cost))
    guide = archive.order[rank]
    if archive.spread[guide, 0, 0] == _UNKNOWN:
        _spread(archive, guide)
    least = colony.wide if uniform(state) < colony.exploration else colony.least
    vary(archive.ants[ant], archive.sequence[guide], archive.spread[guide], colony.xi, least, archive.block, limits, state)


@bare_kernel
def take(archive: Archive, n: int, problem: ControlProblem) -> None:
    """Judge the first n ants abreast, and insert those that are good enough."""
    judge_all(archive.ants[:n], problem, worst(archive), archive.ant_cost)
    for i in range(n):
        insert(archive, i)


@kernel
def refill(archive: Archive, lattice: ControlLattice, problem: ControlProblem, most: int) -> None:
    """Fill the archive for a new problem: with its best sequences, up to `most`, then the best arcs, then the seeds."""
    n = min(archive.used[0], most)
    for i in range(n):
        copy_rows(archive.sequence[archive.order[i]], archive.ants[i])
    archive.used[0] = 0
    take(archive, n, problem)
    n = 0
    if problem.outlook.near[:-1].any():
        best_arcs(archive.ants[0], lattice, problem)
        n = 1
    path, span = problem.batch.path, problem.limits.v_max * archive.ants.shape[1] * problem.dt
    points = descend(path, problem.field, problem.start.x, problem.start.y, span)
    for i in range(SEEDS):
        n += int(write_seed(archive.ants[n], problem, path, points, i))
    take(archive, n, problem)


@kernel
def forage(
    archive: Archive, lattice: ControlLattice, colony: ControlColonySettings, problem: ControlProblem, state: State
) -> None:
    """Improve the archive for the robot's problem, in rounds of ants."""
    refill(archive, lattice, problem, len(archive.cost))
    for _ in range(colony.rounds):
        archive.spread[:, 0, 0] = _UNKNOWN
        for i in range(colony.ants):
            draw(archive, i, colony, problem.limits, state)
        take(archive, colony.ants, problem)
    copy_rows(archive.sequence[archive.order[0], :-1], archive.ants[0, 1:])
    archive.ants[0, 0] = 0.0  # the best sequence a period later; until then the robot brakes
    take(archive, 1, problem)
