"""Ants in the space of controls (ACO_R): the pheromone is an archive of good sequences, shifted from cycle to cycle.

Socha and Dorigo: Ant colony optimization for continuous domains, European Journal of Operational Research 185, 2008.
An ant picks a guide from the archive by rank. It draws its own sequence around the guide with the spread of the archive.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import inner_kernel, kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.base.rng import State, next_bits, uniform
from antway.kernels.controls.lattice import Lattice, best_arcs
from antway.kernels.controls.rollout import HEADING, CostWeights, Outlook, StaticField, judge
from antway.kernels.controls.seeds import along_plan, downhill, turn_and_go


class Archive(NamedTuple):
    """Sequences of controls in fixed slots, and their order by cost."""

    sequence: NDArray[np.float64]  # [K, S, 2]
    cost: NDArray[np.float64]  # [K] s
    order: NDArray[np.int64]  # [K] slots, best first
    spread: NDArray[np.float64]  # [K, B, 2] mean distance of a sequence to the others, by block
    used: NDArray[np.int64]  # [1] number of slots in use
    ant: NDArray[np.float64]  # [S, 2] scratch for the sequence of one ant
    nothing: NDArray[np.float64]  # [0, 2] passed to a rollout whose path is not needed


class ColonySettings(NamedTuple):
    """Numbers of the colony."""

    rounds: int
    ants: int
    block: int  # number of steps that share a draw
    choosiness: float  # q; a guide is picked with the weight exp(-rank^2 / (2 q^2 K^2))
    breath: float  # standard deviation of a draw in units of the archive's spread
    least_a: float  # m/s; least standard deviation of the first control
    least_b: float  # rad/s or m/s; least standard deviation of the second control
    curious: float  # share of ants with the larger least standard deviations `wide_a` and `wide_b`
    wide_a: float  # m/s
    wide_b: float  # rad/s or m/s


@inner_kernel
def normal(state: State) -> float:
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
def _spread(archive: Archive, place: int, block: int) -> None:
    """Compute the mean distance of a sequence to the others, block by block."""
    n = archive.used[0]
    mine = archive.sequence[place]
    for b in range(archive.spread.shape[1]):
        k = min(b * block + block // 2, len(mine) - 1)
        da, db = 0.0, 0.0
        for i in range(n):
            other = archive.sequence[archive.order[i]]
            da += abs(other[k, 0] - mine[k, 0])
            db += abs(other[k, 1] - mine[k, 1])
        archive.spread[place, b, 0], archive.spread[place, b, 1] = da / max(n - 1, 1), db / max(n - 1, 1)


@inner_kernel
def insert(archive: Archive, cost: float, block: int) -> bool:
    """Insert the ant if the archive has space or the ant is better than the worst; return whether it is now the best."""
    n, most = archive.used[0], len(archive.cost)
    if n == most:
        if cost >= archive.cost[archive.order[n - 1]]:
            return False
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
    for k in range(archive.ant.shape[0]):
        archive.sequence[place, k, 0], archive.sequence[place, k, 1] = archive.ant[k, 0], archive.ant[k, 1]
    archive.used[0] = n + 1
    _spread(archive, place, block)
    return bool(i == 0)


@inner_kernel
def worst(archive: Archive) -> float:
    """Return the cost below which an ant is inserted, s."""
    n = archive.used[0]
    most: float = archive.cost[archive.order[n - 1]] if n == len(archive.cost) else math.inf
    return most


@kernel
def shift(archive: Archive) -> None:
    """Shift all sequences by one step; the last control is repeated."""
    for p in range(archive.used[0]):
        q = archive.sequence[p]
        for k in range(len(q) - 1):
            q[k, 0], q[k, 1] = q[k + 1, 0], q[k + 1, 1]


@inner_kernel
def vary(
    out: NDArray[np.float64],
    guide: NDArray[np.float64],
    spread: NDArray[np.float64],
    breath: float,
    least: tuple[float, float],
    block: int,
    limits: RobotLimits,
    state: State,
) -> None:
    """Draw a sequence around a guide within the robot's limits, with one normal number for each block and control.

    The standard deviation is `breath` times `spread`, float64[B, 2], and at least `least`.
    """
    holonomic = limits.drive == HOLONOMIC
    slowest = -limits.v_max if holonomic else -limits.v_reverse
    turn = limits.v_max if holonomic else limits.turn_rate
    da, db = 0.0, 0.0
    for k in range(len(out)):
        if k % block == 0:
            da = normal(state) * max(breath * spread[k // block, 0], least[0])
            db = normal(state) * max(breath * spread[k // block, 1], least[1])
        out[k, 0] = min(max(guide[k, 0] + da, slowest), limits.v_max)
        out[k, 1] = min(max(guide[k, 1] + db, -turn), turn)


@inner_kernel
def draw(archive: Archive, colony: ColonySettings, limits: RobotLimits, state: State) -> None:
    """Draw one ant around a guide that is picked by rank."""
    n = archive.used[0]
    rank = n
    while rank >= n:
        rank = int(abs(normal(state)) * colony.choosiness * len(archive.cost))
    guide = archive.order[rank]
    curious = uniform(state) < colony.curious
    least = (colony.wide_a, colony.wide_b) if curious else (colony.least_a, colony.least_b)
    spread = archive.spread[guide]
    vary(archive.ant, archive.sequence[guide], spread, colony.breath, least, colony.block, limits, state)


@inner_kernel
def take(
    archive: Archive,
    block: int,
    start: NDArray[np.float64],
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    outlook: Outlook,
    weights: CostWeights,
) -> None:
    """Compute the cost of the ant, and insert it if it is good enough."""
    insert(archive, judge(archive.ant, start, limits, dt, field, outlook, weights, worst(archive), archive.nothing), block)


@inner_kernel
def take_seeds(
    archive: Archive,
    lattice: Lattice,
    block: int,
    start: NDArray[np.float64],
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    outlook: Outlook,
    weights: CostWeights,
) -> None:
    """Judge and insert the seeds: arcs, turn and go, reverse, stop, down the field, beside that, and along the plan."""
    steps = len(archive.ant)
    if outlook.near.any():
        best_arcs(archive.ant, lattice, start, limits, dt, field, outlook, weights)
        take(archive, block, start, limits, dt, field, outlook, weights)
    for i in range(36 + 6):
        if i < 24:
            speed = limits.v_max if i % 2 == 0 else 0.5 * limits.v_max
            turn_and_go(archive.ant, start, limits, dt, start[HEADING] + (i // 2) * math.pi / 6.0, speed)
        elif i < 27:
            if limits.drive == HOLONOMIC or limits.v_reverse == 0.0:
                continue
            turn_and_go(archive.ant, start, limits, dt, start[HEADING] + math.pi + (i - 25) * 0.5, -limits.v_reverse)
        elif i == 27:
            archive.ant[:] = 0.0
        elif i < 30:
            downhill(archive.ant, start, limits, dt, field, 0.5, limits.v_max if i == 28 else 0.6 * limits.v_max, 0.0, 0)
        elif i < 36:  # pass an obstacle on its left or on its right
            aside = 0.25 if i < 34 else 0.7
            until = steps // 2 if 32 <= i < 34 else steps // 4
            downhill(archive.ant, start, limits, dt, field, 0.5, limits.v_max, aside if i % 2 == 0 else -aside, until)
        elif outlook.plan[0, 2] > -math.inf:
            along_plan(archive.ant, start, limits, dt, outlook, 3 if i < 39 else 6, 4 * (i % 3))
        else:
            continue
        take(archive, block, start, limits, dt, field, outlook, weights)


@kernel
def forage(
    archive: Archive,
    lattice: Lattice,
    colony: ColonySettings,
    start: NDArray[np.float64],
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    outlook: Outlook,
    weights: CostWeights,
    state: State,
) -> float:
    """Improve the archive for a robot in the state `start`, float64[5]; return the cost of the best sequence, s.

    The sequences of the archive are judged again, seeds are added, and then the ants go their rounds.
    """
    n = archive.used[0]
    archive.used[0] = 0
    kept, before = archive.sequence[:n].copy(), archive.order[:n].copy()
    block = colony.block
    for i in range(n):
        for k in range(len(archive.ant)):
            archive.ant[k, 0], archive.ant[k, 1] = kept[before[i], k, 0], kept[before[i], k, 1]
        take(archive, block, start, limits, dt, field, outlook, weights)
    take_seeds(archive, lattice, block, start, limits, dt, field, outlook, weights)
    for _ in range(colony.rounds):
        for i in range(archive.used[0]):
            _spread(archive, i, block)
        for _ in range(colony.ants):
            draw(archive, colony, limits, state)
            take(archive, block, start, limits, dt, field, outlook, weights)
    best: float = archive.cost[archive.order[0]]
    return best
