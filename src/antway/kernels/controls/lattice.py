"""Best-first search for a sequence of controls over arcs in space and time; it finds gaps that ants seldom find by chance.

A* on a state lattice (Pivtoraiko, Knepper and Kelly: Differentially constrained mobile robot motion planning in state lattices,
Journal of Field Robotics 26, 2009). Arcs need not end on lattice points here. Of similar poses at one time, the cheapest is
kept.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.heap import pop, push
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState
from antway.kernels.base.rows import copy_row
from antway.kernels.controls import abreast
from antway.kernels.controls.lookup import at_goal, time_to_go, turning_loss
from antway.kernels.controls.motion import MotionState, motion_state
from antway.kernels.controls.problem import Batch, ControlProblem
from antway.kernels.controls.rollout import lost_time
from antway.kernels.controls.seeds import descend, downhill

DOWNHILL = 2  # number of arcs that follow the field down, at full and at half speed, besides those of a constant command
_HEADINGS = 16  # poses are similar only if their headings are in the same one of this many sectors
_SPEEDS = 3  # poses are similar only if their speeds are in the same one of this many parts of full speed
_CELL = 0.4  # 1; poses are similar only if they are in the same square, whose edge is this times the longest arc
# Columns of a node: place in m, cosine and sine of the heading, speed and turn rate (or vx and vy), and cost in s.
X, Y, COS, SIN, SPEED, SPIN, COST = range(7)
PARENT, ARCS, DONE = range(3)  # columns of a link: the node before, the number of arcs since the start, 1 at the goal
_TOUCHES = -1  # value of DONE


class ControlLattice(NamedTuple):
    """Commands to choose from, and memory for a search over them."""

    held: Floats  # [M, 2] speed and turn rate, or vx and vy, held for a whole arc
    node: Floats  # [N, 7] state at the end of an arc
    link: Ints  # [N, 3]
    command: Floats  # [N, B, 2] command in each period of the arc
    heap: Floats  # [N, 2] lower bound on the time to the goal through the node, s, and the node
    key: Ints  # [H, 2] hash table of the poses: the pose's key, and the number of the search
    least: Floats  # [H] least lower bound of the pose, s
    search: Ints  # [1] number of the last search
    expansions: int  # most nodes that are expanded


@inner_kernel
def _state_at(row: Floats) -> MotionState:
    """Return the motion state of a node."""
    return MotionState(row[X], row[Y], row[COS], row[SIN], row[SPEED], row[SPIN])


@inner_kernel
def _store(row: Floats, at: MotionState, cost: float) -> None:
    """Write a node."""
    row[X], row[Y], row[COS], row[SIN], row[SPEED], row[SPIN] = at
    row[COST] = cost


@inner_kernel
def _drive_arcs(lattice: ControlLattice, parent: int, first: int, count: int, problem: ControlProblem) -> None:
    """Drive `count` arcs from node `parent` abreast, by the commands of the new nodes from `first` on, and fill these nodes.

    DONE is `_TOUCHES` where an arc touches a wall or an obstacle.
    """
    node, link, dt, w, batch = lattice.node, lattice.link, problem.dt, problem.weights, problem.batch
    value, block, at, n = batch.value, lattice.command.shape[1], _state_at(node[parent]), count
    for i in range(n):
        abreast.set_rollout(value, i, at)
        value[abreast.SPENT + i], batch.sequence[i] = node[parent, COST], i
        link[first + i, PARENT], link[first + i, ARCS], link[first + i, DONE] = parent, link[parent, ARCS] + 1, _TOUCHES
    for q in range(block):
        k, to = link[parent, ARCS] * block + q, 0
        for i in range(n):
            new = first + batch.sequence[i]
            value[abreast.ONE + i], value[abreast.TWO + i] = lattice.command[new, q, 0], lattice.command[new, q, 1]
        abreast.drive(value, n, problem.limits, dt)
        abreast.wall_distances(value, n, problem, w.wall_margin)
        if problem.outlook.near[k] > 0:
            abreast.obstacle_costs(batch, n, k, 1.0, problem)
        for i in range(n):
            harm = value[abreast.HARM + i] if problem.outlook.near[k] > 0 else 0.0
            if value[abreast.WALL + i] >= w.wall_margin and harm < w.contact:
                value[abreast.SPENT + i] += harm / block
                abreast.close_up(batch, i, to)
                ends = at_goal(problem.field, abreast.rollout_state(value, to))
                if ends or q == block - 1:
                    new, cost = first + batch.sequence[to], value[abreast.SPENT + to] - (block - 1 - q) * dt
                    link[new, DONE] = int(ends)
                    _store(node[new], abreast.rollout_state(value, to), cost + block * dt)
                to += int(not ends)
        n = to


@inner_kernel
def _move(lattice: ControlLattice, new: int, to: int) -> None:
    """Move a node to row `to`."""
    copy_row(lattice.node[new], lattice.node[to])
    copy_row(lattice.link[new], lattice.link[to])
    for q in range(lattice.command.shape[1]):
        copy_row(lattice.command[new, q], lattice.command[to, q])


@inner_kernel
def _bound(lattice: ControlLattice, node: int, problem: ControlProblem) -> float:
    """Return the time from the start to the goal through a node, without moving obstacles beyond the node, s."""
    at, cost = _state_at(lattice.node[node]), lattice.node[node, COST]
    if lattice.link[node, DONE] == 1:
        return float(cost)
    to_go = time_to_go(problem.field, at)
    lost = turning_loss(problem.field, at, to_go) + lost_time(at, to_go, problem.field, problem.limits)
    return float(cost + to_go + lost)


@inner_kernel
def _better(lattice: ControlLattice, node: int, bound: float, limits: RobotLimits, longest: float) -> bool:
    """Tell whether the node has the lowest bound of all similar poses after as many arcs; if so, store it."""
    row = lattice.node[node]
    col, line = math.floor(row[X] / (_CELL * longest)), math.floor(row[Y] / (_CELL * longest))
    turn = math.floor(math.atan2(row[SIN], row[COS]) * (_HEADINGS / (2.0 * math.pi)) + 0.5) % _HEADINGS
    speed = math.floor(_SPEEDS * row[SPEED] / limits.v_max + 0.5) + _SPEEDS
    spin = math.floor(_SPEEDS * row[SPIN] / limits.v_max + 0.5) + _SPEEDS
    if limits.drive != HOLONOMIC:
        spin = math.floor(row[SPIN] / limits.turn_rate + 1.5)
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
def best_arcs(ant: Floats, lattice: ControlLattice, problem: ControlProblem) -> float:
    """Write the best sequence of arcs to `ant`, float64[S, 2]; the rest of `ant` is a stop.

    If the expansions are used up first, it is the best of the longest sequences found. Returns the time to the goal, without
    moving obstacles beyond the end of the sequence, s. It is infinite if the search did not finish or all arcs touch something.
    """
    node, link, command, heap = lattice.node, lattice.link, lattice.command, lattice.heap
    limits, dt, batch = problem.limits, problem.dt, problem.batch
    summed = Batch(batch.value, batch.sequence, batch.harm[:, :0], batch.path)  # the costs of all steps are added up
    block = command.shape[1]
    arcs, held = len(ant) // block, len(lattice.held)
    longest = limits.v_max * block * dt
    lattice.search[0] += 1
    _store(node[0], motion_state(problem.start), 0.0)
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
        x, y, cos, sin, speed, spin = _state_at(node[at])
        start = RobotState(x, y, math.atan2(sin, cos), speed, spin)
        from_node = ControlProblem(start, limits, dt, problem.field, problem.outlook, problem.weights, summed)
        first = used
        for i in range(held):
            for q in range(block):
                command[first + i, q, 0], command[first + i, q, 1] = lattice.held[i, 0], lattice.held[i, 1]
        points = descend(batch.path, problem.field, x, y, longest)
        for i in range(DOWNHILL):
            speed = limits.v_max if i == 0 else 0.5 * limits.v_max
            downhill(command[first + held + i], from_node, batch.path, points, speed, 0.0, 0)
        _drive_arcs(lattice, at, first, held + DOWNHILL, from_node)
        for new in range(first, first + held + DOWNHILL):
            if link[new, DONE] != _TOUCHES:
                bound = _bound(lattice, new, from_node)
                if _better(lattice, new, bound, limits, longest):
                    _move(lattice, new, used)
                    size = push(heap, size, bound, used)
                    used += 1
    ant[:] = 0.0
    while link[last, PARENT] >= 0:
        first = (link[last, ARCS] - 1) * block
        for q in range(block):
            ant[first + q, 0], ant[first + q, 1] = command[last, q, 0], command[last, q, 1]
        last = link[last, PARENT]
    return found
