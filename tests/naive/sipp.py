"""Slow and obvious twins of the space-time kernels."""

from __future__ import annotations

import heapq

import numpy as np

from naive.geometry import hits_cells


def move_mask(blocked, offsets, radius):
    """Legal moves by sampling the distance to each blocked cell; also the margin by which each move was decided."""
    rows, cols = blocked.shape
    legal = np.zeros((rows, cols, len(offsets)), dtype=bool)
    margin = np.empty((rows, cols, len(offsets)))
    for (r, c, k), _ in np.ndenumerate(legal):
        least = hits_cells(blocked, (r, c), (r + offsets[k, 0], c + offsets[k, 1]), radius, True, samples=41)
        legal[r, c, k], margin[r, c, k] = least >= radius, abs(least - radius)
    return legal, margin


def move_field(mask, offsets, lengths, goals):
    """Dijkstra backwards with a heap and a dictionary."""
    rows, cols = mask.shape
    best = {tuple(goal): 0.0 for goal in goals}
    heap = [(0.0, tuple(goal)) for goal in goals]
    while heap:
        d, (row, col) = heapq.heappop(heap)
        if d > best[row, col]:
            continue
        for k, (dr, dc) in enumerate(offsets):
            r, c = row - dr, col - dc
            if 0 <= r < rows and 0 <= c < cols and mask[r, c] >> k & 1 and d + lengths[k] < best.get((r, c), np.inf):
                best[r, c] = d + lengths[k]
                heapq.heappush(heap, (best[r, c], (r, c)))
    field = np.full((rows, cols), np.inf)
    for cell, d in best.items():
        field[cell] = d
    return field


NEVER = 1e3  # s; longer than any of these worlds takes


def course_pieces(radius, knot_t, knot_xy, first, t0, horizon):
    """Each obstacle's pieces of uniform motion as rows (begin, end, x, y, vx, vy, radius)."""
    rows = []
    for k, low in enumerate(first[:-1]):
        t, xy = knot_t[low : first[k + 1]], knot_xy[low : first[k + 1]]
        for since, end in zip([t0, *t[t > t0]], [*t[t > t0], NEVER]):
            end = min(end, horizon)
            if since < end:
                a = [np.interp(since, t, xy[:, i]) for i in (0, 1)]
                b = [np.interp(min(end, NEVER), t, xy[:, i]) for i in (0, 1)]
                rows.append((since, end, *a, *(np.subtract(b, a) / (end - since)), radius[k]))
    return np.array(rows).reshape(-1, 7)


def nearest(a, b, duration, depart, segments):
    """Least distance of a disc going from a to b from `depart` on from each piece while it lasts; broadcasts."""
    since, end, x, y, vx, vy, _ = np.moveaxis(segments, -1, 0)
    low, high = np.maximum(depart, since), np.minimum(depart + duration, end)
    ux, uy = (b - a)[..., 0] / np.maximum(duration, 1e-12), (b - a)[..., 1] / np.maximum(duration, 1e-12)
    px = x + vx * (low - since) - a[..., 0] - ux * (low - depart)
    py = y + vy * (low - since) - a[..., 1] - uy * (low - depart)
    wx, wy = vx - ux, vy - uy
    when = -(px * wx + py * wy) / np.maximum(wx * wx + wy * wy, 1e-300)
    when = np.clip(when, 0.0, np.maximum(high - low, 0.0))
    return np.hypot(px + wx * when, py + wy * when)


def unsafe(a, b, duration, segments, contact_radius):
    """The unsafe departures of each move past each piece, [low, high] (low > high: none).

    The least distance is a convex function of the departure (least distances over convex sets are), so ternary search finds
    its minimum and bisection where it crosses the reach on both sides.
    """
    low, high = np.broadcast_arrays(segments[:, 0] - duration, segments[:, 1] + 0 * duration)
    low, high = low.copy(), high.copy()
    first, last = low.copy(), high.copy()
    for _ in range(75):
        p, q = low + (high - low) / 3, high - (high - low) / 3
        left = nearest(a, b, duration, p, segments) <= nearest(a, b, duration, q, segments)
        low, high = np.where(left, low, p), np.where(left, q, high)
    middle = (low + high) / 2
    contact = nearest(a, b, duration, middle, segments) < contact_radius
    move, piece = np.nonzero(contact)
    known = a[move, 0], b[move, 0], duration[move, 0]

    def cross(edge, never):
        outer, inner, found = edge[contact], middle[contact], np.full(contact.shape, never)
        ends_in_contact = nearest(*known, outer, segments[piece]) < contact_radius[piece]
        for _ in range(60):
            half = (outer + inner) / 2
            hit = nearest(*known, half, segments[piece]) < contact_radius[piece]
            outer, inner = np.where(hit, outer, half), np.where(hit, half, inner)
        found[contact] = np.where(ends_in_contact, edge[contact], inner)
        return found

    return cross(first, np.inf), cross(last, -np.inf)


def sipp(mask, offsets, centre, speed, radius, start, goal, trajectories, t0=0.0, horizon=np.inf):
    """Earliest arrival by Dijkstra over (cell, safe interval); every unsafe interval of every move is computed beforehand.

    `centre` are the cells' centres in m, [H, W, 2]; `trajectories` the arrays (radius, knot_t, knot_xy, first).
    """
    segments = course_pieces(*trajectories, t0, horizon)
    contact_radius = radius + segments[:, 6] - 1e-9
    cells = list(np.ndindex(mask.shape))
    stays = unsafe(*(np.array([centre[c] for c in cells])[:, None],) * 2, np.zeros((len(cells), 1)), segments, contact_radius)
    moves = [(c, (c[0] + dr, c[1] + dc)) for c in cells for k, (dr, dc) in enumerate(offsets) if int(mask[c]) >> k & 1]
    a, b = (np.array([centre[m[i]] for m in moves]).reshape(-1, 1, 2) for i in (0, 1))
    duration = np.hypot(*np.moveaxis(b - a, -1, 0)) / speed
    leaves = unsafe(a, b, duration, segments, contact_radius)
    safe = {c: gaps(stays[0][i], stays[1][i], t0) for i, c in enumerate(cells)}
    outgoing = {c: [] for c in cells}
    for i, (c, d) in enumerate(moves):
        outgoing[c].append((d, duration[i, 0], gaps(leaves[0][i], leaves[1][i], t0)))
    if not safe[start] or safe[start][0][0] > t0:
        return np.inf
    best = {(start, 0): t0}
    heap = [(t0, start, 0)]
    while heap:
        t, c, i = heapq.heappop(heap)
        if t > best[c, i]:
            continue
        if c == goal:
            return t
        for d, length, windows in outgoing[c]:
            for j, (enter, leave) in enumerate(safe[d]):
                for since, end in windows:
                    s = max(t, since, enter - length)
                    if s <= min(end, safe[c][i][1], leave - length) and s + length < best.get((d, j), np.inf):
                        best[d, j] = s + length
                        heapq.heappush(heap, (s + length, d, j))
    return np.inf


def gaps(low, high, since):
    """The closed intervals from `since` on between the open intervals (low, high); those under a nanosecond are none."""
    free = []
    for a, b in sorted(zip(low, high)):
        if a < b and a > since + 1e-9:
            free.append((since, a))
        if a < b:
            since = max(since, b)
    return [*free, (since, NEVER)] if since < NEVER - 1 else free


def unit_steps(blocked, walks, start, goal):
    """Breadth first over (cell, step): walks[k][n] is the cell of obstacle k in step n, the last one for ever."""
    rows, cols = blocked.shape

    def at(n):
        return [walk[min(n, len(walk) - 1)] for walk in walks]

    layer, n = {start}, 0
    last = max(map(len, walks), default=0) + rows * cols
    while n <= last:
        if goal in layer:
            return n
        now, then = at(n), at(n + 1)
        fresh = set()
        for r, c in layer:
            for cell in ((r, c), (r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
                inside = 0 <= cell[0] < rows and 0 <= cell[1] < cols and not blocked[cell]
                swap = any(p == cell and q == (r, c) for p, q in zip(now, then))
                if inside and cell not in then and not swap:
                    fresh.add(cell)
        layer, n = fresh, n + 1
    return np.inf


def ticks(mask, offsets, centre, radius, start, goal, trajectories, per_step, slack, limit):
    """Breadth first over (cell, tick) at 1 cell a second with `per_step` ticks a move; discs of radius less `slack`."""
    segments = course_pieces(*trajectories, 0.0, np.inf)
    contact_radius = radius + segments[:, 6] - 1e-9 - slack

    def free(a, b, duration, depart):
        a, b = np.array([[a]]), np.array([[b]])
        since, end = segments[:, 0], segments[:, 1]
        lasts = (depart + duration > since) & (depart < end)
        return not (lasts & (nearest(a, b, np.array([[duration]]), depart, segments)[0] < contact_radius)).any()

    layers = [set() for _ in range(limit + per_step + 1)]
    if free(centre[start], centre[start], 1e-9, 0.0):
        layers[0].add(start)
    for n in range(limit):
        for cell in layers[n]:
            if cell == goal:
                return n / per_step
            if free(centre[cell], centre[cell], 1 / per_step, n / per_step):
                layers[n + 1].add(cell)
            for k, (dr, dc) in enumerate(offsets):
                other = (cell[0] + dr, cell[1] + dc)
                if int(mask[cell]) >> k & 1 and free(centre[cell], centre[other], 1.0, n / per_step):
                    layers[n + per_step].add(other)
    return np.inf
