"""Forces of potential fields: from walls (Khatib 1986, Ge and Cui 2000) and from moving discs (Ge and Cui 2002)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import kernel

NEAREST = 1e-3  # m; smaller distances count as this, so that forces stay finite


@kernel
def wall_force(
    label: NDArray[np.int32], frame: Floats, x: float, y: float, radius: float, influence: float, near: Floats
) -> tuple[float, float, float]:
    """Return the repulsion of a disc from walls, for a gain of 1; each wall acts from its nearest point.

    At a distance d below `influence`, m, the potential is (1/d - 1/influence)^2 / 2 and the force (1/d - 1/influence) / d^2,
    away from that point. `label` is 0 for free cells, w for cells of wall w, 1 <= w <= W; the four edges of the map are walls
    of their own. `frame` is x and y of the map's corner and the edge of a cell, float64[3], m. `near`, float64[W + 5, 3], is
    scratch: distance of each wall, and the direction from it to the disc. Returns the sum of the forces, (fx, fy), and twice
    the sum of the potentials.
    """
    rows, cols = label.shape
    size = frame[2]
    near[:, 0] = math.inf
    row, col, span = (y - frame[1]) / size, (x - frame[0]) / size, (radius + influence) / size + 1.0
    for i in range(max(math.floor(row - span), 0), min(math.floor(row + span), rows - 1) + 1):
        for j in range(max(math.floor(col - span), 0), min(math.floor(col + span), cols - 1) + 1):
            if label[i, j]:
                dx = x - min(max(x, frame[0] + j * size), frame[0] + (j + 1) * size)
                dy = y - min(max(y, frame[1] + i * size), frame[1] + (i + 1) * size)
                d = math.hypot(dx, dy)
                if d < near[label[i, j], 0] and d > 0.0:
                    near[label[i, j]] = d, dx / d, dy / d
    edge = len(near) - 4
    near[edge] = x - frame[0], 1.0, 0.0
    near[edge + 1] = frame[0] + cols * size - x, -1.0, 0.0
    near[edge + 2] = y - frame[1], 0.0, 1.0
    near[edge + 3] = frame[1] + rows * size - y, 0.0, -1.0
    fx = fy = u = 0.0
    for k in range(1, len(near)):
        d = max(near[k, 0] - radius, NEAREST)
        if d < influence:
            depth = 1.0 / d - 1.0 / influence
            fx += depth / (d * d) * near[k, 1]
            fy += depth / (d * d) * near[k, 2]
            u += depth * depth
    return fx, fy, u


@kernel
def disc_force(
    x: float,
    y: float,
    vx: float,
    vy: float,
    radius: float,
    brake: float,
    influence: float,
    xy: Floats,
    velocity: Floats,
    radii: Floats,
) -> tuple[float, float, int]:
    """Return the repulsion of a disc from moving discs, for a gain of 1, by distance and relative velocity.

    Let d be the distance between the edges, v the speed of approach along the line n of the centres, v' e the rest of the
    relative velocity, and b = v^2 / 2a the braking distance. The potential is 1 / (d - b) - 1 / influence where v > 0 and
    d - b < influence. The force is (-(1 + v/a) n + v v' / (a r) e) / (d - b)^2, where r is the distance of the centres (the
    paper writes d; for discs the gradient gives r). `brake` is the deceleration a, m/s^2; the moving discs are `xy`, `velocity`
    and `radii`, m and m/s. Returns the sum of the forces, (fx, fy), and the disc with the strongest force, -1 for none.
    """
    fx = fy = most = 0.0
    obstacle = -1
    for k in range(len(radii)):
        nx, ny = xy[k, 0] - x, xy[k, 1] - y
        r = max(math.hypot(nx, ny), NEAREST)
        nx, ny = nx / r, ny / r
        ux, uy = vx - velocity[k, 0], vy - velocity[k, 1]
        v = ux * nx + uy * ny
        gap = max(r - radius - radii[k] - v * v / (2.0 * brake), NEAREST)
        if v > 0.0 and gap < influence:
            gx = (-(1.0 + v / brake) * nx + v * (ux - v * nx) / (brake * r)) / (gap * gap)
            gy = (-(1.0 + v / brake) * ny + v * (uy - v * ny) / (brake * r)) / (gap * gap)
            fx += gx
            fy += gy
            if gx * gx + gy * gy > most:
                most, obstacle = gx * gx + gy * gy, k
    return fx, fy, obstacle
