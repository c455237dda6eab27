"""Ant colonies by the definitions, over edge dictionaries: the slow, obvious twin of the room `kernels/colony`."""

from __future__ import annotations

import math

import numpy as np

M64 = 2**64 - 1


def mix(z):
    """splitmix64's output function."""
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & M64
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & M64
    return z ^ (z >> 31)


class Stream:
    """A stream of splitmix64."""

    def __init__(self, seed, index):
        self.state = mix((seed + mix((index + 0x9E3779B97F4A7C15) & M64)) & M64)

    def bits(self):
        self.state = (self.state + 0x9E3779B97F4A7C15) & M64
        return mix(self.state)


def walk(matrix, near, weight, seed, index, q0=0.0, guess=True):
    """One ant's tour by roulette over the candidates, with probability q0 the candidate of largest weight instead.

    First over all but the city it came from; if that draws a visited one, over those not visited; else the nearest city left.
    Without `guess` the first of these draws is left out.
    """
    stream = Stream(seed, index)
    n = len(matrix)
    order = [((stream.bits() >> 32) * n) >> 32]
    while len(order) < n:
        i = order[-1]
        others = [c for c, j in enumerate(near[i]) if len(order) < 2 or j != order[-2] or i not in near[j]]
        came = [c for c in range(len(near[i])) if c not in others]
        whole = sum(float(w) for w in weight[i])
        rest = whole - sum(float(weight[i][c]) for c in came)
        greedy = q0 > 0.0 and (stream.bits() >> 11) * 2.0**-53 < q0
        if guess and not greedy:
            draw = (stream.bits() >> 11) * 2.0**-53 * rest
            drawn = None
            for c in others:
                draw -= float(weight[i][c])
                if draw < 0.0:
                    drawn = int(near[i][c])
                    break
            if drawn is not None and rest >= 1e-9 * whole and drawn not in order:
                order.append(drawn)
                continue
        sums, total = [], np.float32(0.0)
        for c, j in enumerate(near[i]):
            if j not in order:
                total = np.float32(total + weight[i][c])
            sums.append(total)
        share = np.float32(np.float32(stream.bits() >> 41) * np.float32(2.0**-23))
        if total > 0 and greedy:
            order.append(int(max((j for j in near[i] if j not in order), key=lambda j: weight[i][list(near[i]).index(j)])))
        elif total > 0:
            draw = share * total
            order.append(int(near[i][next(c for c, s in enumerate(sums) if s > draw)]))
        else:
            order.append(min((j for j in range(n) if j not in order), key=lambda j: (matrix[i][j], j)))
    return order


def select(orders, lengths, seed, cycle):
    """The tours that the ants go on from: in turn, each its own or, if it is shorter, that of an ant drawn for it."""
    stream, tours = Stream(mix(seed), cycle), list(zip(lengths, orders, strict=True))
    for ant in range(len(tours)):
        other = tours[((stream.bits() >> 32) * len(tours)) >> 32]
        if other[0] < tours[ant][0]:
            tours[ant] = other
    return [order for _, order in tours], [length for length, _ in tours]


def persistence(policy, tau, tau_min, t, excess):
    """rho of an edge."""
    name = type(policy).__name__
    if name == "Constant":
        return policy.rho
    if name == "Adaptive":
        return float(np.clip(math.exp(-tau_min / tau) + math.exp(-t), policy.lo, policy.hi))
    if name == "Printed":
        return math.exp(tau_min / tau) + math.exp(-t)
    if name == "Decay":
        return max(policy.lo, policy.first * policy.factor**t)
    return policy.lo + (policy.hi - policy.lo) * math.exp(-excess / policy.spread)


def tour_edges(order):
    return [frozenset((order[i - 1], order[i])) for i in range(len(order))]


def step(rule, tau, tours, lengths, cycle, best):
    """One cycle's update of tau (a dict of frozenset edges) by `rule`; best is (length, tour) so far, this cycle included."""
    kind = type(rule).__name__
    m, n = len(tours), len(tours[0])
    ranked = sorted(range(m), key=lambda k: lengths[k])
    excess = lengths[ranked[0]] / best[0] - 1
    tau_min = min(tau.values())
    rho = {e: persistence(rule.persistence, v, tau_min, cycle, excess) for e, v in tau.items()}
    if kind == "AntColonySystem":
        return {e: rho[e] * v + (1 - rho[e]) * rule.q / best[0] if e in tour_edges(best[1]) else v for e, v in tau.items()}
    gain = dict.fromkeys(tau, 0.0)
    shares = []
    if kind in ("AntSystem", "ElitistAntSystem"):
        shares += [(1.0, lengths[k], tours[k]) for k in range(m)]
    if kind == "ElitistAntSystem":
        shares.append((m if rule.elite is None else rule.elite, *best))
    if kind == "RankBasedAntSystem":
        shares += [(rule.ranks - 1 - r, lengths[k], tours[k]) for r, k in enumerate(ranked[: rule.ranks - 1])]
        shares.append((rule.ranks, *best))
    if kind == "MaxMinAntSystem":
        every = max(pair for pair in rule.schedule if pair[0] <= cycle)[1]
        shares.append((1.0, *best) if (cycle + 1) % every == 0 else (1.0, lengths[ranked[0]], tours[ranked[0]]))
    for times, size, tour in shares:
        for e in tour_edges(tour):
            gain[e] += times * rule.q / size
    tau = {e: rho[e] * v + gain[e] for e, v in tau.items()}
    if kind == "MaxMinAntSystem":
        high = rule.q / (max(1 - rule.persistence.rho, 1e-3) * best[0])
        p = rule.p_best ** (1 / n)
        low = min(high, high * (1 - p) / (((rule.choices or 0.5 * n) - 1) * p))
        tau = {e: min(max(v, low), high) for e, v in tau.items()}
    return tau
