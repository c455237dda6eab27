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
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState
from antway.kernels.controls.lookup import at_goal, clearance, time_to_go, turning_loss
from antway.kernels.controls.motion import MotionState, motion_state, step
from antway.kernels.controls.problem import ControlProblem, Outlook
from antway.kernels.controls.rollout import lost_time, obstacle_cost
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


@inner_kernel
def _state_at(row: NDArray[np.float64]) -> MotionState:
    """Return the motion state of a node."""
    return MotionState(row[X], row[Y], row[COS], row[SIN], row[SPEED], row[SPIN])


@inner_kernel
def _store(row: NDArray[np.float64], at: MotionState, cost: float) -> None:
    """Write a node."""
    row[X], row[Y], row[COS], row[SIN], row[SPEED], row[SPIN] = at
    row[COST] = cost


@inner_kernel
def _drive(lattice: Lattice, parent: int, new: int, problem: ControlProblem) -> bool:
    """Drive the arc from node `parent` to node `new`, and fill the new row; tell whether it touches no wall and no obstacle."""
    commands, link, w = lattice.command[new], lattice.link, problem.weights
    at, cost = _state_at(lattice.node[parent]), lattice.node[parent, COST]
    block = len(commands)
    first = link[parent, ARCS] * block
    link[new, PARENT], link[new, ARCS], link[new, DONE] = parent, link[parent, ARCS] + 1, 0
    for q in range(block):
        before, at = at, step(at, commands[q, 0], commands[q, 1], problem.limits, problem.dt)
        if clearance(problem.field, at, w.wall_margin) < w.wall_margin:
            return False
        if problem.outlook.near[first + q] > 0:
            harm = obstacle_cost(before, at, first + q, 1.0, problem)
            if harm >= w.contact:
                return False
            cost += harm / block
        if at_goal(problem.field, at):
            link[new, DONE] = 1
            cost -= (block - 1 - q) * problem.dt
            break
    _store(lattice.node[new], at, cost + block * problem.dt)
    return True


@inner_kernel
def _bound(lattice: Lattice, node: int, problem: ControlProblem) -> float:
    """Return the time from the start to the goal through a node, without moving obstacles beyond the node, s."""
    at, cost = _state_at(lattice.node[node]), lattice.node[node, COST]
    if lattice.link[node, DONE] == 1:
        done: float = cost
        return done
    to_go = time_to_go(problem.field, at)
    lost = turning_loss(problem.field, at) + lost_time(at, to_go, problem.field, problem.limits)
    bound: float = cost + to_go + lost
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
def best_arcs(ant: NDArray[np.float64], lattice: Lattice, problem: ControlProblem) -> float:
    """Write the best sequence of arcs to `ant`; the rest of `ant` is a stop.

    If the expansions are used up first, it is the best of the longest sequences found. Returns the time to the goal, without
    moving obstacles beyond the end of the sequence, s. It is infinite if the search did not finish or all arcs touch something.

    Parameters
    ----------
    ant : float64[S, 2]
        Speed and turn rate, or vx and vy, commanded in each period.
    """
    node, link, command, heap = lattice.node, lattice.link, lattice.command, lattice.heap
    limits, dt, outlook = problem.limits, problem.dt, problem.outlook
    # Without a place for what each obstacle costs, the costs of all steps are added up.
    summed = Outlook(outlook.near, outlook.disc, outlook.beyond, outlook.harm[:0], outlook.plan)
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
        from_node = ControlProblem(start, limits, dt, problem.field, summed, problem.weights)
        for i in range(held + DOWNHILL):
            if i < held:
                for q in range(block):
                    command[used, q, 0], command[used, q, 1] = lattice.held[i, 0], lattice.held[i, 1]
            else:
                downhill(command[used], from_node, _LOOK, limits.v_max if i == held else 0.5 * limits.v_max, 0.0, 0)
            if _drive(lattice, at, used, from_node):
                bound = _bound(lattice, used, from_node)
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
