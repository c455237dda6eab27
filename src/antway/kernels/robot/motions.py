"""How moving obstacles move: straight, and mirrored at walls."""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Bools, Floats
from antway.kernels.base.geometry import first_wall, reflected, segment_hits_cells
from antway.kernels.base.jit import kernel
from antway.kernels.base.rng import State, uniform


@kernel
def bounce(
    blocked: Bools,
    row: float,
    col: float,
    speed: float,
    angle: float,
    radius: float,
    turn_every: float,
    horizon: float,
    state: State,
    knot_t: Floats,
    knot_rc: Floats,
) -> int:
    """Write the motion of a disc that goes straight, is mirrored at walls and edges, and turns at random now and then.

    Its centre at time 0, its radius and its speed are in cells and cells/s, and `angle` is its initial direction, atan2(d_row,
    d_col), rad. Between random changes of direction are `turn_every` s; infinite for none. The knots up to `horizon` s are
    written to knot_t, float64[M], s, and knot_rc, float64[M, 2]. Returns their number, or M + 1 if they did not fit.
    """
    vr, vc = speed * math.sin(angle), speed * math.cos(angle)
    t, turn, n = 0.0, turn_every, 1
    knot_t[0], knot_rc[0, 0], knot_rc[0, 1] = 0.0, row, col
    standing = 0  # reflections in a row without any motion; after more than 8 the disc is wedged and waits for its next turn
    while t < horizon:
        end = min(turn, horizon)
        if standing > 8:
            vr, vc = 0.0, 0.0
        share, n_row, n_col = first_wall(blocked, row, col, vr * (end - t), vc * (end - t), radius)
        mirrored = share <= 1.0
        later = t + share * (end - t) if mirrored else end
        if later > t:
            if n == len(knot_t):
                return n + 1
            row, col, t = row + vr * (later - t), col + vc * (later - t), later
            knot_t[n], knot_rc[n, 0], knot_rc[n, 1] = t, row, col
            n += 1
            standing = 0
        if mirrored:
            standing += 1
            vr, vc = reflected(vr, vc, n_row, n_col)
        elif t >= turn:
            angle = 2.0 * math.pi * uniform(state)
            vr, vc = speed * math.sin(angle), speed * math.cos(angle)
            turn += turn_every
    return n


@kernel
def first_inside(blocked: Bools, knot_t: Floats, knot_rc: Floats, radius: float) -> float:
    """Return when a disc of `radius` cells first comes into contact with a blocked cell, s; infinite if it never does.

    The disc is at knot_rc[i], (row, col) with integers at cell centres, at knot_t[i] s, and moves straight in between. Beyond
    the map nothing is blocked.
    """
    for i in range(len(knot_t)):
        row, col = knot_rc[i, 0], knot_rc[i, 1]
        if segment_hits_cells(blocked, row, col, row, col, radius, False):
            return float(knot_t[i])
        if i + 1 == len(knot_t):
            break
        dr, dc = knot_rc[i + 1, 0] - row, knot_rc[i + 1, 1] - col
        if segment_hits_cells(blocked, row, col, row + dr, col + dc, radius, False):
            free, taken = 0.0, 1.0  # shares of the leg: clear up to `free`, in contact before `taken`
            for _ in range(50):
                middle = 0.5 * (free + taken)
                if segment_hits_cells(blocked, row, col, row + dr * middle, col + dc * middle, radius, False):
                    taken = middle
                else:
                    free = middle
            return float(knot_t[i] + taken * (knot_t[i + 1] - knot_t[i]))
    return math.inf
