"""Ants on a grid as one would write them down: Python integers, lists and dictionaries, one edge at a time."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

MASK = 2**64 - 1


def mix(z):
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


class Dice:
    """splitmix64 begun at stream `index` of `seed`."""

    def __init__(self, seed, index):
        self.state = mix((seed + mix((index + 0x9E3779B97F4A7C15) & MASK)) & MASK)

    def bits(self):
        self.state = (self.state + 0x9E3779B97F4A7C15) & MASK
        return mix(self.state)


def roulette(weights, bits):
    """The move drawn by the upper 23 bits, None if none has weight; partial sums are float32, made of pairs."""
    w = [np.float32(v) for v in weights]
    pair = w[0] + w[1]
    half = pair + (w[2] + w[3])
    rest = w[4] + w[5]
    sums = [w[0], pair, pair + w[2], half, half + w[4], half + rest, half + (rest + w[6]), half + (rest + (w[6] + w[7]))]
    drawn = np.float32(bits >> 41) * np.float32(2**-23) * sums[7]
    return next((k for k in range(8) if sums[k] > drawn), None)


def walk(weights, offsets, start, goal, limit, retreat, greedy, turn, seed, ant):
    """The moves of one ant, None if it died, and the steps it made. A colony without greed guesses first."""
    dice, path, cell, visited = Dice(seed, ant), [], start, {start}
    for step in range(limit):
        if cell == goal:
            return path, step
        last = path[-1] if path else 8
        open_ = [weights[cell, k] * turn[last, k] if cell + offsets[k] not in visited else np.float32(0) for k in range(8)]
        bits = dice.bits()
        k = roulette(weights[cell], bits) if greedy == 0 else None
        if k is None or cell + offsets[k] in visited or np.float32(bits % 2**23) * np.float32(2**-23) >= turn[last, k]:
            k = roulette(open_, dice.bits())
        if k is None:
            if not retreat or not path:
                return None, step + 1
            cell -= offsets[path.pop()]
            continue
        if greedy > 0 and (dice.bits() >> 11) * 2.0**-53 < greedy:
            k = int(np.argmax(open_))
        path.append(k)
        cell += offsets[k]
        visited.add(cell)
    return (path, limit) if cell == goal else (None, limit)


def edges(offsets, start, path):
    """The (cell, move) pairs of a path."""
    cells = start + np.concatenate(([0], np.cumsum([offsets[k] for k in path]))).astype(int)
    return list(zip(cells.tolist(), path))


def length(path):
    return math.inf if path is None else math.fsum(math.sqrt(2) if k >= 4 else 1.0 for k in path)


def rho(policy, tau, least, t, excess):
    """Persistence of one edge, by the name of the policy's class."""
    kind = type(policy).__name__
    if kind == "Constant":
        return policy.rho
    if kind == "Adaptive":
        return min(max(math.exp(-least / tau) + math.exp(-t), policy.lo), policy.hi)
    if kind == "Printed":
        return math.exp(least / tau) + math.exp(-t)
    if kind == "Decay":
        return max(policy.lo, policy.first * policy.factor**t)
    return policy.lo + (policy.hi - policy.lo) * math.exp(-excess / policy.spread)


def update(rule, tau, first, low, high, offsets, start, paths, best, t):
    """The end of cycle `t` since the last restart on {(cell, move): pheromone}; `best` is the best path so far, or None."""
    kind, tau = type(rule).__name__, dict(tau)
    ranked = sorted((p for p in paths if p is not None), key=length)
    excess = length(ranked[0]) / length(best) - 1 if ranked else math.inf

    def deposit(path, times):
        for edge in edges(offsets, start, path):
            tau[edge] += times * rule.q / length(path)

    if kind == "AntColonySystem":
        for path in paths:
            for edge in edges(offsets, start, path or []):
                tau[edge] = (1 - rule.xi) * tau[edge] + rule.xi * first
        left = rho(rule.persistence, 1.0, 1.0, t, excess)
        for edge in edges(offsets, start, best or []):
            tau[edge] = left * tau[edge] + max(1 - left, 0) * rule.q / length(best)
    else:
        least = min(tau.values())
        tau = {edge: rho(rule.persistence, value, least, t, excess) * value for edge, value in tau.items()}
        if kind == "AntSystem":
            for path in ranked:
                deposit(path, 1)
        elif kind == "ElitistAntSystem":
            for path in ranked:
                deposit(path, 1)
            if best:
                deposit(best, len(paths) if rule.elite is None else rule.elite)
        elif kind == "RankBasedAntSystem":
            for r, path in enumerate(ranked[: rule.ranks - 1], start=1):
                deposit(path, rule.ranks - r)
            if best:
                deposit(best, rule.ranks)
        elif (t + 1) % max(pair for pair in rule.schedule if pair[0] <= t)[1] == 0:
            if best:
                deposit(best, 1)
        elif ranked:
            deposit(ranked[0], 1)
    return {edge: min(max(value, low), high) for edge, value in tau.items()}


def costs_to_go(legal, offsets, lengths, cost, turn, goal):
    """Least cost to `goal` beginning with each move: Bellman's equation, swept until nothing changes."""
    n = len(legal)
    value = np.full((n, 8), math.inf)
    moves = [(i, k) for i in range(n) for k in range(8) if legal[i] >> k & 1 and offsets[k] and i != goal]
    while True:
        before = value.copy()
        for i, k in moves:
            j = i + offsets[k]
            rest = 0.0 if j == goal else min(value[j, m] + (0.0 if m == k else turn) for m in range(8))
            value[i, k] = lengths[k] * 0.5 * (cost[i] + cost[j]) + rest
        if np.array_equal(before, value):
            return value


def score(offsets, lengths, start, path, clearance, danger):
    """Length, turns, -(least clearance) and the integral of the danger along one path."""
    cells = [start + sum(offsets[k] for k in path[:i]) for i in range(len(path) + 1)]
    exposure = sum(lengths[k] * (danger[a] + danger[b]) / 2 for k, (a, b) in zip(path, pairwise(cells)))
    return [length(path), sum(a != b for a, b in pairwise(path)), -min(clearance[c] for c in cells), exposure]


def front(legal, offsets, lengths, start, goal):
    """The exact Pareto front (length, turns): shortest walks with at most 0, 1, 2, ... turns over (cell, last move)."""
    n, result = len(legal), []
    reached = {}  # (cell, last move) -> length with as many turns as the layer
    for turns in range(n):
        layer = {}
        if turns == 0:
            heap = [(0.0, start, k) for k in range(8)]
        else:
            heap = [(d, c, k) for (c, last), d in reached.items() for k in range(8) if k != last]
        for d, c, k in heap:  # straight on from every way of having turned here
            while c != goal and legal[c] >> k & 1 and offsets[k]:
                c, d = c + offsets[k], d + lengths[k]
                if d >= min(layer.get((c, k), math.inf), reached.get((c, k), math.inf)):
                    break
                layer[c, k] = d
        for key, d in layer.items():
            reached[key] = min(d, reached.get(key, math.inf))
        best = min((d for (c, _), d in reached.items() if c == goal), default=math.inf)
        if best < (result[-1][0] if result else math.inf) - 1e-9:
            result.append((best, turns))
        if not layer:
            return result[::-1]
    return result[::-1]
