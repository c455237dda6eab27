"""Swept tests by dense sampling: slow and obvious."""

from __future__ import annotations

import numpy as np


def sampled_discs(p, v, contact_radius, dt, samples=10_000):
    """Least sampled distance over [0, dt], its time, and the first sampled time of contact (inf: none)."""
    t = np.linspace(0.0, dt, samples)
    d = np.hypot(p[0] + v[0] * t, p[1] + v[1] * t)
    i = int(d.argmin())
    inside = np.flatnonzero(d < contact_radius - 1e-9)
    return d[i], t[i], t[inside[0]] if len(inside) else np.inf


def sampled_timeline(a, b, t0, t1, contact_radius, knot_t, knot_xy, samples=10_000):
    """The same for a straight step from a at t0 to b at t1 against a timeline; every knot is a sample as well."""
    t = np.union1d(np.linspace(t0, t1, samples), knot_t[(knot_t >= t0) & (knot_t <= t1)])
    s = (t - t0) / (t1 - t0) if t1 > t0 else np.zeros_like(t)
    x = a[0] + s * (b[0] - a[0]) - np.interp(t, knot_t, knot_xy[:, 0])
    y = a[1] + s * (b[1] - a[1]) - np.interp(t, knot_t, knot_xy[:, 1])
    d = np.hypot(x, y)
    i = int(d.argmin())
    inside = np.flatnonzero(d < contact_radius - 1e-9)
    return d[i], t[i], t[inside[0]] if len(inside) else np.inf


def sampled_square(a, b, cell, half, samples=10_000):
    """Least sampled distance of the segment a b from the square of half edge `half` around `cell`."""
    s = np.linspace(0.0, 1.0, samples)
    r = np.maximum(np.abs(a[0] + s * (b[0] - a[0]) - cell[0]) - half, 0.0)
    c = np.maximum(np.abs(a[1] + s * (b[1] - a[1]) - cell[1]) - half, 0.0)
    return np.hypot(r, c).min()


def hits_cells(blocked, a, b, radius, walled, samples=2_000):
    """Least sampled distance of the segment from any blocked cell (and the map's outside where `walled`)."""
    rows, cols = blocked.shape
    least = min([sampled_square(a, b, cell, 0.5, samples) for cell in np.argwhere(blocked)], default=np.inf)
    if walled:
        edge = min(min(p[0] + 0.5, rows - 0.5 - p[0], p[1] + 0.5, cols - 0.5 - p[1]) for p in (a, b))
        least = min(least, edge)
    return least
