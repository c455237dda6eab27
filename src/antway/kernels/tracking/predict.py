"""Where tracks will be: straight on, mirrored at walls, in tubes that widen with what is not known of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import first_wall
from antway.kernels.base.jit import kernel

X, Y, VX, VY, RADIUS, SIGMA, SIGMA_V, NAME = range(8)  # columns of a belief, one row a track
MIRRORS = 4  # at most, of one track
STEP_TIME = 0.25  # s; a course is a velocity for each such step
NO_PREDICTIONS = np.empty((0, 1, 2))  # no courses
_TIERS = (0.25, 0.5, 0.75, 1.0)  # s; a tube that widens does so in steps
LATER, _SPARED = 2.5, 0.1  # s, m; of a course that turns, what is so far ahead is not worth the whole berth
_KNOWN = 1.0  # s; tubes widen no further: by then there is a newer plan, and a wider tube would close every way


@kernel
def predict(
    estimates: NDArray[np.float64],
    now: float,
    age: float,
    horizon: float,
    robot_x: float,
    robot_y: float,
    robot_radius: float,
    margin: float,
    speed_bound: float,
    surge_bound: float,
    stopping_time: float,
    quantile: float,
    blocked: NDArray[np.bool_],
    frame: NDArray[np.float64],
    prediction: NDArray[np.float64],
    out: NDArray[np.float64],
) -> int:
    """Turn beliefs about tracks into pieces (kernels/spacetime/segments.py) for a robot at (robot_x, robot_y).

    Parameters
    ----------
    estimates : float64[K, 8]
        x, y (m), vx, vy (m/s), radius (m), standard deviations of place (m) and of velocity (m/s), and the track's id.
    now, age, horizon : float
        Time now; how old the beliefs are; how far ahead to predict; s.
    margin, quantile : float
        Added to the radii, m; times the standard deviation at each time.
    speed_bound, surge_bound, stopping_time : float
        No obstacle is faster than `speed_bound` m/s, nor faster than now by more than `surge_bound` m/s^2 for each s. A moving robot keeps
        clear of all that an obstacle could reach from where it was `stopping_time` s before; pieces begin so much earlier.
    blocked, frame : bool[H, W], float64[3]
        The map; x and y of its corner and the edge of a cell, m.
    prediction : float64[N, S, 2]
        Velocities of the first N tracks in steps of COURSE s, m/s; NaN for those that go straight on, as the rest do.
    out : float64[P, 8]

    Returns
    -------
    int
        Number of pieces written. The margins of a track that the robot is within already are cut to what there is, so that it
        may stand there; its body never is. So is the room that a moving robot keeps, for the first `stopping_time` s: it may leave at
        once if it comes no nearer meanwhile and has its full room then, which is what a guard asks of the first period. Later
        on a robot keeps less of that room to one who moves on a course: by then there is a newer plan.
    """
    n = 0
    size = frame[2]
    for k in range(len(estimates)):
        x, y, vx, vy = estimates[k, X], estimates[k, Y], estimates[k, VX], estimates[k, VY]
        body = robot_radius + estimates[k, RADIUS]
        slack = math.hypot(x + vx * age - robot_x, y + vy * age - robot_y) - body
        runs = min(speed_bound, math.hypot(vx, vy) + surge_bound * stopping_time) * stopping_time
        held = min(slack + body, math.hypot(x + vx * (age - stopping_time) - robot_x, y + vy * (age - stopping_time) - robot_y))
        spread = math.hypot(estimates[k, SIGMA], estimates[k, SIGMA_V] * (_TIERS[0] + age))
        within = held < body + margin + quantile * spread + runs
        x, y, t, mirrors = x - vx * stopping_time, y - vy * stopping_time, -age - stopping_time, 0
        turns = k < len(prediction) and not math.isnan(prediction[k, 0, 0])
        while t < horizon and n < len(out):
            end = horizon
            sure = estimates[k, SIGMA] == 0.0 and estimates[k, SIGMA_V] == 0.0
            if not sure:
                for tier in _TIERS:
                    if tier > t + 1e-9:
                        end = min(tier, horizon)
                        break
            if turns and mirrors == 0:
                i = int((t + age + 1e-9) / STEP_TIME)
                if t < -age - 1e-9:
                    end = min(end, -age)
                elif i < len(prediction[k]):
                    vx, vy = prediction[k, i, 0], prediction[k, i, 1]
                    while i + 1 < len(prediction[k]) and prediction[k, i + 1, 0] == vx and prediction[k, i + 1, 1] == vy:
                        if abs((i + 1) * STEP_TIME - LATER) < 1e-9:
                            break
                        i += 1
                    end = min(end, (i + 1) * STEP_TIME - age)
            past = within and t < -1e-9
            if past:
                end = min(end, 0.0)
            col, row = (x - frame[0]) / size - 0.5, (y - frame[1]) / size - 0.5
            share, n_row, n_col = first_wall(
                blocked, row, col, vy * (end - t) / size, vx * (end - t) / size, estimates[k, RADIUS] / size
            )
            hit = share <= 1.0 and mirrors < MIRRORS
            until = t + share * (end - t) if hit else end
            if until > t:
                variance = estimates[k, SIGMA] ** 2 + (estimates[k, SIGMA_V] * min(max(until + age, 0.0), _KNOWN)) ** 2
                wide = margin + quantile * math.sqrt(variance)
                out[n, 0], out[n, 1] = now + t, now + until
                out[n, 2], out[n, 3], out[n, 4], out[n, 5] = x, y, vx, vy
                out[n, 6] = body + max(min(wide, slack - 1e-6), 0.0)
                out[n, 7] = max(held - 1e-6, 0.0) if past else body + wide + runs
                if turns and t > LATER - 1e-9 and vx * vx + vy * vy > 0.01:
                    out[n, 7] = max(out[n, 7] - _SPARED, out[n, 6])
                n += 1
                x, y, t = x + vx * (until - t), y + vy * (until - t), until
            if hit:
                mirrors += 1
                into = vx * n_col + vy * n_row
                vx, vy = vx - 2.0 * into * n_col, vy - 2.0 * into * n_row
    return n
