"""Ants that walk on a grid: the heuristic, Eq. (1) as a table of weights, the roulette, the walk, the deposit of pheromone.

The map is flat with a margin, as in `kernels.search.best_first.Graph`. A move is one of 0 to 7, a path a sequence of moves.
Arrays [N, 8] hold a value for each move from each cell, 0 if it is illegal.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rng import GAMMA, mix, stream
from antway.kernels.colony.pheromone import ADAPTIVE, PRINTED, Numbers, best_deposits, persistence

F32 = np.float32
FLOOR = 1e-30  # least weight of a legal move, as a share of the largest weight of its cell; only illegal moves have weight 0
NEAR = 1e-3  # cells; smaller distances to the target count as this, so that an ant beside the target steps onto it
LOW, HIGH = 1e-150, 1e150  # limits of pheromone for rules without limits, so that it never becomes 0 or infinite
_UNIT = np.float32(2.0**-23)  # factor that turns 23 random bits into a number in [0, 1)
_LOW = np.uint64(0x7FFFFF)  # mask of the lower 23 bits


class GridGraph(NamedTuple):
    """The graph that the ants walk."""

    legal: NDArray[np.uint32]  # [N] bit k is set if move k from the cell is legal
    offsets: NDArray[np.int64]  # [8] flat step of each move; 0 for moves that there are not
    lengths: Floats  # [8] length of each move, cells
    start: int  # flat cell
    goal: int  # flat cell


class Paths(NamedTuple):
    """The paths of the ants of a cycle."""

    moves: NDArray[np.uint8]  # [A, L] moves of each path, from its start
    depth: NDArray[np.int32]  # [A] number of moves, -1 for an ant that died
    length: Floats  # [A] L_k in cells, infinite for an ant that died


class Pheromone(NamedTuple):
    """The pheromone on a grid."""

    tau: Floats  # [N, 8] pheromone on each move out of each cell
    eta: Floats  # [N, 8] heuristic of each move to the power beta, 0 where it is not legal
    tau_0: float  # initial pheromone
    tau_min: float  # lower limit for legal moves
    tau_max: float  # upper limit


class CostsToGo(NamedTuple):
    """The least costs from each cell to the goal, between two calls of `costs_to_go`."""

    value: Floats  # [N, 8] for each first move; infinite if there is no path
    least: Floats  # [N] the least of these
    queue: NDArray[np.int64]  # [N + 1] a ring of cells whose values have decreased
    waiting: NDArray[np.bool_]  # [N] whether each cell is in the queue
    ends: NDArray[np.int64]  # [2] place of the first cell in the queue, and the one after the last


@kernel
def visibility(
    graph: GridGraph, distance: Floats, reachable: NDArray[np.bool_], beta: float, detour: bool, low: int, end: int, eta: Floats
) -> None:
    """Write eta^beta of each legal move i -> j between cells of `reachable` to float64[N, 8], up to a factor for each cell i.

    Rows `low` to `end` of `eta` are written; they must be 0 before.
    eta = 1 / distance[j]; with `detour`, eta = exp(-(length of the move + distance[j] - distance[i])), with lengths in cells.
    """
    far = np.empty(8)
    for i in range(low, end):
        if not reachable[i] or graph.legal[i] == 0:
            continue
        best = math.inf
        for k in range(8):
            if (graph.legal[i] >> k) & 1:
                far[k] = (graph.lengths[k] if detour else 0.0) + max(distance[i + graph.offsets[k]], NEAR)
                best = min(best, far[k])
        for k in range(8):
            if (graph.legal[i] >> k) & 1:
                eta[i, k] = max(math.exp(beta * (best - far[k])) if detour else (best / far[k]) ** beta, FLOOR)


@kernel
def weigh(tau: Floats, eta: Floats, alpha: float, weights: NDArray[np.float32]) -> None:
    """Write the numerator of Eq. (1), tau^alpha eta^beta, to float32[N, 8], divided by the largest one of the cell."""
    row = np.empty(8)
    for cell in range(tau.shape[0]):
        strongest, top = 0.0, 0.0
        for k in range(8):
            strongest = max(strongest, tau[cell, k])
        if strongest == 0.0:
            continue
        for k in range(8):
            share = tau[cell, k] / strongest
            row[k] = eta[cell, k] * (share if alpha == 1.0 else share**alpha)
            top = max(top, row[k])
        for k in range(8):
            weights[cell, k] = max(row[k] / top, FLOOR) if tau[cell, k] > 0.0 else 0.0


@kernel
def roulette(w0: F32, w1: F32, w2: F32, w3: F32, w4: F32, w5: F32, w6: F32, w7: F32, bits: np.uint64) -> int:
    """Return k with probability w_k / sum, by the upper 23 of 64 random bits; -1 if the sum is 0.

    The partial sums are added in pairs, so that few additions depend on one another. Even after rounding they never decrease,
    and w_k = 0 leaves two of them equal: a move without weight is never drawn.
    """
    c1 = w0 + w1
    c3 = c1 + (w2 + w3)
    w45 = w4 + w5
    c7 = c3 + (w45 + (w6 + w7))
    drawn = np.float32(bits >> np.uint64(41)) * _UNIT * c7  # less than c7 even after rounding
    if c7 == np.float32(0.0):
        return -1
    return (
        int(w0 <= drawn)
        + int(c1 <= drawn)
        + int(c1 + w2 <= drawn)
        + int(c3 <= drawn)
        + int(c3 + w4 <= drawn)
        + int(c3 + w45 <= drawn)
        + int(c3 + (w45 + w6) <= drawn)
    )


@kernel
def walk(
    graph: GridGraph,
    weights: NDArray[np.float32],
    retreat: bool,
    greedy: float,
    turn: NDArray[np.float32],
    seed: np.uint64,
    first: int,
    moves: NDArray[np.uint8],
    depth: NDArray[np.int32],
    stamp: NDArray[np.int32],
) -> int:
    """Let the ants first, first + 1, ... walk from the start, one for each row of `moves`; return the total number of steps.

    Each step draws among the unvisited neighbours by the roulette over `weights`, Eq. (1); with probability `greedy` it takes
    the move of largest weight instead (the pseudo-random proportional rule). turn[a, b] in [0, 1] scales the weight of move b
    after move a; row 8 is for the start. In a dead end the ant goes back one cell and never enters the dead end again, so paths
    have no loops; without `retreat` it dies. It also dies if it has not reached the goal after as many steps, those back
    included, as `moves` has columns.

    `moves`, uint8[A, L], and `depth`, int32[A], are written: the moves of each path and their number, -1 for an ant that died.
    `stamp`, int32[N], is scratch, which is zeroed once; ant numbers must not repeat. Ant a draws from `stream(seed, a)`, so its
    path does not depend on other threads.
    """
    steps, limit, offsets, start, goal = 0, moves.shape[1], graph.offsets, graph.start, graph.goal
    zero = np.float32(0.0)
    o0, o1, o2, o3 = offsets[0], offsets[1], offsets[2], offsets[3]
    o4, o5, o6, o7 = offsets[4], offsets[5], offsets[6], offsets[7]
    for ant in range(moves.shape[0]):
        mine = np.int32(first + ant + 1)
        state = stream(seed, np.uint64(first + ant))
        cell, length, made, last = start, 0, 0, 8
        stamp[cell] = mine
        while cell != goal and made < limit:
            made += 1
            state += GAMMA
            bits = mix(state)
            k = -1
            if greedy == 0.0:
                # Rejection sampling: draw among all moves and accept with the probability of the turn, unless the cell was
                # visited. The step has the same distribution as the roulette below, mostly without looking at all neighbours.
                row = weights[cell]
                k = roulette(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], bits)
                if k >= 0 and (stamp[cell + offsets[k]] == mine or np.float32(bits & _LOW) * _UNIT >= turn[last, k]):
                    k = -1
            if k < 0:
                w0 = weights[cell, 0] * turn[last, 0] if stamp[cell + o0] != mine else zero
                w1 = weights[cell, 1] * turn[last, 1] if stamp[cell + o1] != mine else zero
                w2 = weights[cell, 2] * turn[last, 2] if stamp[cell + o2] != mine else zero
                w3 = weights[cell, 3] * turn[last, 3] if stamp[cell + o3] != mine else zero
                w4 = weights[cell, 4] * turn[last, 4] if stamp[cell + o4] != mine else zero
                w5 = weights[cell, 5] * turn[last, 5] if stamp[cell + o5] != mine else zero
                w6 = weights[cell, 6] * turn[last, 6] if stamp[cell + o6] != mine else zero
                w7 = weights[cell, 7] * turn[last, 7] if stamp[cell + o7] != mine else zero
                state += GAMMA
                bits = mix(state)
                k = roulette(w0, w1, w2, w3, w4, w5, w6, w7, bits)
                if k < 0:
                    if not retreat or length == 0:
                        break
                    length -= 1
                    cell -= offsets[moves[ant, length]]
                    last = int(moves[ant, length - 1]) if length > 0 else 8
                    continue
                if greedy > 0.0:
                    state += GAMMA
                    if float(mix(state) >> np.uint64(11)) * 2.0**-53 < greedy:
                        top = max(max(max(w0, w1), max(w2, w3)), max(max(w4, w5), max(w6, w7)))
                        k = 0
                        for w in (w0, w1, w2, w3, w4, w5, w6):
                            if w == top:
                                break
                            k += 1
            last = k
            moves[ant, length] = last
            length += 1
            cell += offsets[last]
            stamp[cell] = mine
        depth[ant] = length if cell == goal else -1
        steps += made
    return steps


@kernel
def measure(moves: NDArray[np.uint8], depth: NDArray[np.int32], length: Floats) -> None:
    """Write L_k in cells to float64[A]; infinite for an ant that died. Moves 4 to 7 are diagonal."""
    for ant in range(depth.size):
        diagonal = 0
        for i in range(depth[ant]):
            diagonal += moves[ant, i] >> 2
        length[ant] = depth[ant] - diagonal + diagonal * math.sqrt(2.0) if depth[ant] >= 0 else math.inf


@bare_kernel
def local_update(graph: GridGraph, xi: float, pheromone: Pheromone, paths: Paths) -> None:
    """Do the local update of ACS for all ants of the cycle at once, so that they can walk in parallel."""
    for ant in range(paths.depth.size):
        cell = graph.start
        for i in range(paths.depth[ant]):
            k = paths.moves[ant, i]
            pheromone.tau[cell, k] += xi * (pheromone.tau_0 - pheromone.tau[cell, k])
            cell += graph.offsets[k]


@kernel
def update(
    graph: GridGraph,
    rule: Numbers,
    pheromone: Pheromone,
    paths: Paths,
    order: NDArray[np.int64],
    best_path: NDArray[np.uint8],
    best: float,
    t: int,
) -> None:
    """End a cycle by Eq. (2): pheromone evaporates, and ants that arrived deposit multiples of Q / L_k by the rule.

    `order` ranks the ants by length. `best_path` and `best` are the best so far (empty and infinite if there is none). `t` is
    the number of cycles done since the last restart.
    """
    tau, eta, offsets = pheromone.tau, pheromone.eta, graph.offsets
    moves, depth, length = paths.moves, paths.depth, paths.length
    if rule.xi > 0.0:
        local_update(graph, rule.xi, pheromone, paths)
    shortest = length[order[0]]
    excess = shortest / best - 1.0 if shortest < math.inf else math.inf
    if rule.best_only:
        rho = persistence(rule.persistence_rule, 1.0, 1.0, t, excess)
        cell = graph.start
        for k in best_path:
            tau[cell, k] = rho * tau[cell, k] + max(1.0 - rho, 0.0) * rule.q / best
            cell += offsets[k]
    else:
        evaporate(tau, eta, rule.persistence_rule, t, excess)
        champion = best_deposits(rule.schedule, t)
        if rule.elite > 0.0 and (champion or len(rule.schedule) == 0):
            deposit(graph, tau, best_path, len(best_path), rule.elite * rule.q / best)
        for rank in range(depth.size):
            ant = order[rank]
            if not champion and depth[ant] >= 0 and rule.deposit_weight[rank] > 0.0:
                deposit(graph, tau, moves[ant], depth[ant], rule.deposit_weight[rank] * rule.q / length[ant])
    for cell in range(tau.shape[0]):
        for k in range(8):
            if eta[cell, k] > 0.0:
                tau[cell, k] = min(max(tau[cell, k], pheromone.tau_min), pheromone.tau_max)


@kernel
def evaporate(tau: Floats, eta: Floats, persistence_rule: Floats, t: int, excess: float) -> None:
    """Let pheromone on legal moves (`eta` > 0) evaporate: tau becomes rho tau, rho by `persistence` for `t` and `excess`."""
    by_edge = persistence_rule[0] == ADAPTIVE or persistence_rule[0] == PRINTED
    rho, least = 1.0, math.inf
    if by_edge:
        for cell in range(tau.shape[0]):
            for k in range(8):
                if eta[cell, k] > 0.0:
                    least = min(least, tau[cell, k])
    else:
        rho = persistence(persistence_rule, 1.0, 1.0, t, excess)
    last = math.nan  # most edges have the pheromone of the one before, so that its persistence is theirs
    for cell in range(tau.shape[0]):
        for k in range(8):
            if eta[cell, k] > 0.0:
                if by_edge and tau[cell, k] != last:
                    last = tau[cell, k]
                    rho = persistence(persistence_rule, last, least, t, excess)
                tau[cell, k] *= rho


@kernel
def deposit(graph: GridGraph, tau: Floats, path: NDArray[np.uint8], depth: int, amount: float) -> None:
    """Add `amount` to the pheromone on each of the first `depth` moves of a path."""
    cell = graph.start
    for i in range(depth):
        tau[cell, path[i]] += amount
        cell += graph.offsets[path[i]]


@kernel
def entropy(tau: Floats) -> float:
    """Return the entropy of the pheromone over all moves, nats: the log of their number at first, small when converged."""
    flat = tau.reshape(tau.size)
    top = flat.max()
    if top == 0.0:
        return 0.0
    mass = logs = last = share = term = 0.0
    for value in flat:
        if value != last:
            last, share = value, value / top
            term = share * math.log(share) if share > 0.0 else 0.0
        mass += share
        logs += term
    return math.log(mass) - logs / mass


def no_costs(graph: GridGraph) -> CostsToGo:
    """Return the costs to go before the first call of `costs_to_go`."""
    size = graph.legal.size
    queue = np.empty(size + 1, np.int64)
    queue[0] = graph.goal
    value, least = np.full((size, 8), math.inf), np.full(size, math.inf)
    return CostsToGo(value, least, queue, np.zeros(size, np.bool_), np.array([0, 1]))


@bare_kernel
def costs_to_go(graph: GridGraph, cost: Floats, turn: float, known: CostsToGo, steps: int) -> bool:
    """Go on with the least costs to the goal, for up to `steps` cells of the queue; tell whether they are final.

    A move costs its length times the mean of `cost`, float64[N] > 0, at its ends, plus `turn` >= 0 if the previous move was a
    different one. The method is label correcting, with a queue of cells whose values have decreased.
    """
    legal, offsets, lengths, goal = graph.legal, graph.offsets, graph.lengths, graph.goal
    value, least, queue, waiting = known.value, known.least, known.queue, known.waiting
    head, tail = known.ends[0], known.ends[1]
    while head != tail and steps > 0:
        steps -= 1
        j = queue[head]
        head = (head + 1) % queue.size
        waiting[j] = False
        for k in range(8):
            i = j - offsets[k]
            if i in (j, goal) or not (legal[i] >> k) & 1:
                continue
            rest = 0.0 if j == goal else min(value[j, k], least[j] + turn)
            new = lengths[k] * 0.5 * (cost[i] + cost[j]) + rest
            if new < value[i, k] * (1.0 - 1e-12):
                value[i, k] = new
                least[i] = min(least[i], new)
                if not waiting[i]:
                    waiting[i] = True
                    queue[tail] = i
                    tail = (tail + 1) % queue.size
    known.ends[0], known.ends[1] = head, tail
    return bool(head == tail)


@kernel
def weights_by_cost(value: Floats, beta: float) -> NDArray[np.float32]:
    """Return the weights exp(-beta * excess cost of the move), float32[N, 8], from the result `value` of `costs_to_go`."""
    weights = np.zeros(value.shape, np.float32)
    for i in range(value.shape[0]):
        best = value[i].min()
        for k in range(8):
            if value[i, k] < math.inf:
                weights[i, k] = max(math.exp(beta * (best - value[i, k])), FLOOR)
    return weights


@kernel
def score(graph: GridGraph, moves: NDArray[np.uint8], depth: NDArray[np.int32], clearance: Floats, danger: Floats) -> Floats:
    """Return float64[A, 4]: length, turns, -(least clearance on the path), and integral of the danger along the path.

    `clearance` and `danger` are float64[N]. The integral uses the mean of both ends of a move, as `costs_to_go` does. Lengths
    are in cells. All values are infinite for an ant that died.
    """
    start, offsets, lengths = graph.start, graph.offsets, graph.lengths
    out = np.full((depth.size, 4), math.inf)
    for ant in range(depth.size):
        if depth[ant] < 0:
            continue
        cell, diagonal, turns, narrowest, exposure = start, 0, 0, clearance[start], 0.0
        for i in range(depth[ant]):
            k = moves[ant, i]
            to = cell + offsets[k]
            diagonal += k >> 2
            turns += int(i > 0 and k != moves[ant, i - 1])
            exposure += lengths[k] * 0.5 * (danger[cell] + danger[to])
            narrowest = min(narrowest, clearance[to])
            cell = to
        out[ant, 0] = depth[ant] - diagonal + diagonal * math.sqrt(2.0)
        out[ant, 1], out[ant, 2], out[ant, 3] = turns, -narrowest, exposure
    return out
