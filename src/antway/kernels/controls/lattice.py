"""Best-first search for a sequence of controls over arcs in space and time; it finds gaps that ants seldom find by chance.

A* on a state lattice (Pivtoraiko, Knepper and Kelly: Differentially constrained mobile robot motion planning in state lattices,
Journal of Field Robotics 26, 2009). Arcs need not end on lattice points here. Of similar poses at one time, the cheapest is
kept.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.heap import pop, push
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.controls.rollout import (
    HEADING,
    SX,
    SY,
    A,
    B,
    CostWeights,
    Outlook,
    StaticField,
    clearance,
    lost_time,
    met,
    sample,
    step,
    turning_loss,
)
from antway.kernels.controls.seeds import downhill

DOWNHILL = 2  # number of arcs that follow the field down, at full and at half speed, besides those of a constant command
_LOOK = 0.5  # m; these arcs steer to the point this far down the field
_HEADINGS = 16  # poses are similar only if their headings are in the same one of this many sectors
_SPEEDS = 3  # poses are similar only if their speeds are in the same one of this many parts of full speed
_CELL = 0.4  # 1; poses are similar only if they are in the same square, whose edge is this times the longest arc
# Columns of a node: place in m, cosine and sine of the heading, speed and turn rate (or vx and vy), and cost in s.
X, Y, COS, SIN, SPEED, SPIN, COST = range(7)
PARENT, ARCS, DONE = range(3)  # columns of a link: the node before, the number of arcs since the start, 1 at the goal


class Lattice(NamedTuple):
    """Commands to choose from, and memory for a search over them."""

    held: NDArray[np.float64]  # [M, 2] speed and turn rate, or vx and vy, held for a whole arc
    node: NDArray[np.float64]  # [N, 7] state at the end of an arc
    link: NDArray[np.int64]  # [N, 3]
    command: NDArray[np.float64]  # [N, B, 2] command in each period of the arc
    heap: NDArray[np.float64]  # [N, 2] lower bound on the time to the goal through the node, s, and the node
    key: NDArray[np.int64]  # [H, 2] hash table of the poses: the pose's key, and the number of the search
    least: NDArray[np.float64]  # [H] least lower bound of the pose, s
    search: NDArray[np.int64]  # [1] number of the last search
    expansions: int  # most nodes that are expanded
    state: NDArray[np.float64]  # [5] scratch for the pose from which an arc begins
    harm: NDArray[np.float64]  # [0] empty, so that contact costs are summed over all steps near an obstacle


@inner_kernel
def _drive(
    lattice: Lattice,
    at: int,
    new: int,
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    outlook: Outlook,
    w: CostWeights,
) -> bool:
    """Drive the arc from node `at` to node `new`, and fill the new row; tell whether it touches no wall and no obstacle."""
    one, other, commands = lattice.node[at], lattice.node[new], lattice.command[new]
    x, y, c, s, a, b, cost = one[X], one[Y], one[COS], one[SIN], one[SPEED], one[SPIN], one[COST]
    block = len(commands)
    first = lattice.link[at, ARCS] * block
    lattice.link[new, PARENT], lattice.link[new, ARCS], lattice.link[new, DONE] = at, lattice.link[at, ARCS] + 1, 0
    for q in range(block):
        x, y, c, s, a, b = step(x, y, c, s, a, b, commands[q, 0], commands[q, 1], limits, dt)
        if clearance(x, y, c, s, w.wall_margin, field) < w.wall_margin:
            return False
        if outlook.near[first + q] > 0:
            harm = met(x, y, c, s, a, b, limits, first + q, 1.0, field, outlook, w)
            if harm >= w.contact:
                return False
            cost += harm / block
        gx, gy = x - field.goal[0], y - field.goal[1]
        if gx * gx + gy * gy < field.goal[2] * field.goal[2]:
            lattice.link[new, DONE] = 1
            cost -= (block - 1 - q) * dt
            break
    other[X], other[Y], other[COS], other[SIN], other[SPEED], other[SPIN], other[COST] = x, y, c, s, a, b, cost + block * dt
    return True


@inner_kernel
def _bound(lattice: Lattice, node: int, field: StaticField, limits: RobotLimits) -> float:
    """Return the time from the start to the goal through a node, without moving obstacles beyond the node, s."""
    row = lattice.node[node]
    x, y, c, s = row[X], row[Y], row[COS], row[SIN]
    if lattice.link[node, DONE] == 1:
        done: float = row[COST]
        return done
    to_go = max(sample(field.time, x, y, field.time_frame), 0.0)
    lost = turning_loss(field, x, y, c, s) + lost_time(x, y, c, s, row[SPEED], row[SPIN], to_go, field, limits)
    bound: float = row[COST] + to_go + lost
    return bound


@inner_kernel
def _better(lattice: Lattice, node: int, bound: float, limits: RobotLimits, longest: float) -> bool:
    """Tell whether the node has the lowest bound of all similar poses after as many arcs; if so, store it."""
    row, wheels = lattice.node[node], limits.drive != HOLONOMIC
    col, line = math.floor(row[X] / (_CELL * longest)), math.floor(row[Y] / (_CELL * longest))
    turn = math.floor(math.atan2(row[SIN], row[COS]) * (_HEADINGS / (2.0 * math.pi)) + 0.5) % _HEADINGS
    speed = math.floor(_SPEEDS * row[SPEED] / limits.v_max + 0.5) + _SPEEDS
    spin = (
        math.floor(row[SPIN] / limits.turn_rate + 1.5)
        if wheels
        else math.floor(_SPEEDS * row[SPIN] / limits.v_max + 0.5) + _SPEEDS
    )
    key = np.int64(line % 65536) * 65536 + np.int64(col % 65536)
    key = ((key * _HEADINGS + np.int64(turn)) * 8 + np.int64(speed)) * 8 + np.int64(spin)
    key = key * 64 + lattice.link[node, ARCS]
    search, size = lattice.search[0], len(lattice.key)
    at = np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)) % size
    while lattice.key[at, 1] == search:
        if lattice.key[at, 0] == key:
            if lattice.least[at] <= bound:
                return False
            break
        at = (at + 1) % size
    lattice.key[at, 0], lattice.key[at, 1], lattice.least[at] = key, search, bound
    return True


@bare_kernel
def best_arcs(
    ant: NDArray[np.float64],
    lattice: Lattice,
    start: NDArray[np.float64],
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    outlook: Outlook,
    w: CostWeights,
) -> float:
    """Write the best sequence of arcs to `ant`; the rest of `ant` is a stop.

    If the expansions are used up first, it is the best of the longest sequences found. Returns the time to the goal, without
    moving obstacles beyond the end of the sequence, s. It is infinite if the search did not finish or all arcs touch something.

    Parameters
    ----------
    ant : float64[S, 2]
        Speed and turn rate, or vx and vy, commanded in each period of `dt` s.
    start : float64[5]
        State of the robot.
    """
    node, link, command, heap = lattice.node, lattice.link, lattice.command, lattice.heap
    alone = Outlook(outlook.near, outlook.disc, lattice.harm, outlook.plan)
    block = command.shape[1]
    arcs, held = len(ant) // block, len(lattice.held)
    longest = limits.v_max * block * dt
    lattice.search[0] += 1
    node[0, X], node[0, Y], node[0, COS], node[0, SIN] = (
        start[SX],
        start[SY],
        math.cos(start[HEADING]),
        math.sin(start[HEADING]),
    )
    node[0, SPEED], node[0, SPIN], node[0, COST] = start[A], start[B], 0.0
    link[0, PARENT], link[0, ARCS], link[0, DONE] = -1, 0, 0
    used, size, last, found = 1, push(heap, 0, 0.0, 0), 0, math.inf
    left = lattice.expansions
    while size > 0:
        bound, at = heap[0, 0], int(heap[0, 1])
        size = pop(heap, size)
        if link[at, DONE] == 1 or link[at, ARCS] == arcs:
            last, found = at, bound
            break
        if link[at, ARCS] > link[last, ARCS]:
            last = at
        if left == 0:
            break
        left -= 1
        lattice.state[SX], lattice.state[SY] = node[at, X], node[at, Y]
        lattice.state[HEADING] = math.atan2(node[at, SIN], node[at, COS])
        lattice.state[A], lattice.state[B] = node[at, SPEED], node[at, SPIN]
        for i in range(held + DOWNHILL):
            if i < held:
                for q in range(block):
                    command[used, q, 0], command[used, q, 1] = lattice.held[i, 0], lattice.held[i, 1]
            else:
                speed = limits.v_max if i == held else 0.5 * limits.v_max
                downhill(command[used], lattice.state, limits, dt, field, _LOOK, speed, 0.0, 0)
            if _drive(lattice, at, used, limits, dt, field, alone, w):
                bound = _bound(lattice, used, field, limits)
                if _better(lattice, used, bound, limits, longest):
                    size = push(heap, size, bound, used)
                    used += 1
    ant[:] = 0.0
    while link[last, PARENT] >= 0:
        first = (link[last, ARCS] - 1) * block
        for q in range(block):
            ant[first + q, 0], ant[first + q, 1] = command[last, q, 0], command[last, q, 1]
        last = link[last, PARENT]
    return found
