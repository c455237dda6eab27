"""How long a car takes to the goal from one pose, given that of all others: every way to go on is tried."""

from __future__ import annotations

import math

import numpy as np


def backup(
    poses: np.ndarray,
    times: np.ndarray,
    pose: tuple[int, int, int],
    size: float,
    radius: float,
    turn_rate: float,
    v_max: float,
    v_reverse: float,
) -> float:
    """Return the least time from a pose (heading, row, column) if those of the poses that it leads to are right."""
    headings = len(poses)
    turn = 2.0 * math.pi / headings
    k, row, col = pose
    least = times[row, col] + 60.0
    for speed, sign in ((v_max, 1.0), (v_reverse, -1.0)):
        for side in (-1, 0, 1):
            if speed == 0.0:
                continue
            # drive an arc from one heading to the next, or straight for 1.4 cells, and look where it ends
            length = radius * turn if side else 1.4 * size
            heading, bend = k * turn, side * turn
            if side:
                x = radius / side * (math.sin(heading + bend) - math.sin(heading))
                y = -radius / side * (math.cos(heading + bend) - math.cos(heading))
            else:
                x, y = length * math.cos(heading), length * math.sin(heading)
            r, c = row + sign * y / size, col + sign * x / size
            if not (0.0 <= r <= times.shape[0] - 1 and 0.0 <= c <= times.shape[1] - 1):
                continue
            then = (k + side) % headings
            if np.isinf(poses[then, math.floor(r + 0.5), math.floor(c + 0.5)]):
                continue
            looks = math.ceil(math.hypot(r - row, c - col) - 1e-9)
            shares_of_it = [i / looks for i in range(1, looks)]
            there = [(math.floor(row + (r - row) * one + 0.5), math.floor(col + (c - col) * one + 0.5)) for one in shares_of_it]
            # the body has room on the first half of the way in the heading before, on the second half in the one after
            if any(np.isinf(poses[k if one < 0.5 else then][cell]) for one, cell in zip(shares_of_it, there)):
                continue
            shares = {}
            for i in (math.floor(r), math.floor(r) + 1):
                for j in (math.floor(c), math.floor(c) + 1):
                    share = (1.0 - abs(r - i)) * (1.0 - abs(c - j))
                    if share > 0.0 and np.isfinite(poses[then, i, j]):
                        shares[i, j] = share
            after = sum(share * poses[then][cell] for cell, share in shares.items()) / sum(shares.values())
            took = max(length / speed, turn / turn_rate if side else 0.0)
            least = min(least, took + after)
    return least
