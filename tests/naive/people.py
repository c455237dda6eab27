"""Slow, obvious twins of the kernels about people: harm by dense sampling, averages and noise by the textbook."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from naive.guard import driven


def harm(p, v, heading, command, until, tracks, limits, dt, ahead=2.5, parts=50) -> float:
    """Expected contacts of a robot that drives so, by looking at many instants of each step."""
    radius, x, total = limits[4], np.array(p, float), 0.0
    path, t = [], 0.0
    while t < ahead - 1e-9:
        v, heading = driven(v, heading, command if t < until - 1e-9 else (0.0, 0.0), limits[:4], dt)
        path.append((t, x.copy(), np.array(v)))
        x, t = x + np.array(v) * dt, t + dt
    for row in tracks:
        best, value = math.inf, 0.0
        for begin, at, w in path:
            sigma = 0.04 + 0.15 * (begin + dt / 2)
            s = np.linspace(0.0, dt, parts + 1)
            where = row[:2] + row[2:4] * (row[7] + begin + s)[:, None]
            gaps = np.hypot(*(where - at - w * s[:, None]).T) - radius - row[4]
            i = int(np.argmin(gaps))
            after = begin + s[i]
            if begin == 0.0 and gaps[0] < 0.0:  # in contact already
                i, after = -1, 0.0
            z = 1.7 * gaps[i] / sigma
            score = max(z, 0.0) + after / 1.5
            if gaps[i] < 3.0 * sigma and score < best:
                slow = 1.0 + 0.02 * math.hypot(*w) / limits[0]
                best, value = score, math.exp(-after / 1.5) / (1.0 + math.exp(z)) * slow
        total += value
    return total


def least_harm(p, v, heading, command, tracks, limits, dt, blocked, size, spare):
    """What each candidate costs that keeps `spare` m more than it must from walls, whose edges are `size` m long.

    A candidate goes for 0.3, 0.8 or 2 s, or up to where it still can brake before a wall, and then stands.
    """
    (v_max, a_max, _, _, radius), asked = limits, math.hypot(*command)

    def free(w, far):
        """How far it can go with velocity w, up to `far` m."""
        along = np.arange(0.0, far + 0.002, 0.002)
        path = np.array(p) + along[:, None] * np.array(w) / math.hypot(*w)
        squares = np.argwhere(np.pad(blocked, 1, constant_values=True))[:, ::-1] - 0.5
        away = np.hypot(*np.maximum(np.abs(path[:, None] - squares * size) - size / 2, 0.0).transpose(2, 0, 1)).min(axis=1)
        return min(far, along[(away < radius).argmax()] - spare) if (away < radius).any() else far

    turns = [
        speed * v_max * np.array((math.cos(k * math.pi / 8), math.sin(k * math.pi / 8)))
        for k in range(16)
        for speed in (0.5, 1)
    ]
    worth = {(0.0, 0.0): harm(p, v, heading, (0.0, 0.0), 0.0, tracks, limits, dt)}
    for candidate in [*turns, np.array(command)]:
        speed, first = math.hypot(*candidate), math.hypot(*(w := driven(v, heading, candidate, limits[:4], dt)[0]))
        if speed < 1e-9:
            continue
        brake, stops = speed**2 / (2 * a_max), first * dt + first**2 / (2 * a_max)
        until = (free(candidate, 2.0 * speed + brake) - brake) / speed
        if until < dt or (first > 1e-9 and free(w, stops) < stops):
            continue
        gain = 0.02 * float(candidate @ command) / (asked * v_max) if asked > 0.0 else 0.0
        lasts = [min(one, until) for one in (0.3, 0.8, 2.0)]
        worth[tuple(candidate.tolist())] = min(harm(p, v, heading, candidate, one, tracks, limits, dt) for one in lasts) - gain
    return worth


def chance_of_contact(places, aside, estimates, age, radius, ahead, hold, parts=4000) -> float:
    """Expected number of tracks that touch a robot beside its plan, by looking at many instants."""
    t = np.linspace(0.0, ahead, parts + 1)
    knots = np.linspace(0.0, ahead, len(places))
    moved = places + np.outer(np.minimum(knots, hold), aside)
    robot = np.column_stack([np.interp(t, knots, moved[:, i]) for i in range(2)])
    total = 0.0
    for row in estimates:
        where = row[:2] + np.outer(t + age, row[2:4])
        z = (np.hypot(*(where - robot).T) - radius - row[4]) / (row[6] * (0.1 + t) + 1e-6)
        if z[0] < 0.0:  # in contact already
            z = z[t > knots[1] - 1e-9]
        total += 1.0 / (1.0 + math.exp(min(1.7 * z.min(), 50.0)))
    return total


def chance_by_turns(x, y, estimates, age, radius, dt, angles=3600) -> float:
    """Expected number of tracks that touch a robot at (x, y) after `dt` s if they turn now, by trying many angles."""
    angle, total = (np.arange(angles) + 0.5) * 2.0 * math.pi / angles, 0.0
    for row in estimates:
        at = row[:2] + age * row[2:4] + math.hypot(*row[2:4]) * dt * np.column_stack((np.cos(angle), np.sin(angle)))
        total += (np.hypot(*(at - (x, y)).T) < radius + row[4]).mean()
    return total


def pooled(comparisons, pool, found):
    """Take the errors of a scan into their mean over all tracks: each weighs 1 / n at first, and 0.05 later."""
    n = len(found)
    if n:
        comparisons += n
        pool = pool + max(1 - 0.95**n, n / comparisons) * (np.mean(found, axis=0) - pool)
    return comparisons, pool


def averaged(scans, times=(0.4, 1.2), later=0.8, together=2.5, alike=0.7, sudden=0.7, stops=0.5, stands=0.3):
    """Velocities, and how wrong they may be, of the last scan: whole histories, sums written out.

    A scan is (t, {name: (x, y, vx, vy)}). Returns {name: (vx, vy, sigma)}.
    """
    past = {}  # of each track: all its (t, v)
    began = {}  # of each track and time: from which of these on velocities are averaged, and the weight of the first
    errors, compared, pending = {}, {}, {}  # pending: the forecast (t, place, velocities)
    pool, comparisons = np.zeros(len(times) + 2), 0
    out = {}
    for t, tracks in scans:
        means = {}
        for name, (_, _, vx, vy) in tracks.items():
            history = past.setdefault(name, [])
            history.append((t, np.array([vx, vy])))
            means[name] = [np.array([vx, vy])]
            for tau in times:
                first, weight = began.setdefault((name, tau), (0, 1.0))
                used = history[first:]
                weights = [weight * math.exp(-(t - used[0][0]) / tau)]
                weights += [(1 - math.exp(-(b - a) / tau)) * math.exp(-(t - b) / tau) for (a, _), (b, _) in pairwise(used)]
                mean = sum(w * v for w, (_, v) in zip(weights, used)) / sum(weights)
                now, speed = history[-1][1], math.hypot(*mean)
                wrong = (errors.get(name, np.zeros(1))[0] + 2.0 * pool[0]) / (compared.get(name, 0.0) + 2.0)
                usual = 3.0 * math.sqrt(2.0 / math.pi) * wrong
                change = math.dist(now, mean)
                slower = speed - now @ mean / speed if speed >= stands else change
                if len(history) > 1 and (change > max(sudden, usual) or slower > max(stops, usual)):
                    began[name, tau] = len(history) - 1, 1.0 - math.exp(-(t - history[-2][0]) / tau)
                    mean = now
                means[name].append(mean)
        averages = {name: mean[1] for name, mean in means.items()}
        for name, (x, y, _, _) in tracks.items():
            companions = [
                averages[other]
                for other, (u, v, _, _) in tracks.items()
                if math.dist((x, y), (u, v)) <= together and math.dist(averages[other], averages[name]) <= alike
            ]
            means[name].append(0.5 * (averages[name] + np.mean(companions, axis=0)))
        found = []
        for name, (x, y, _, _) in tracks.items():
            own, seen = errors.setdefault(name, np.zeros(len(pool))), compared.setdefault(name, 0.0)
            if name not in pending or t - pending[name][0] >= later - 1e-6:
                if name in pending and t - pending[name][0] < 2 * later:
                    since, place, velocities = t - pending[name][0], pending[name][1], pending[name][2]
                    off = np.array([math.dist(place + v * since, (x, y)) / since for v in velocities])
                    found.append(off)
                    errors[name], compared[name] = 0.8 * own + off, 0.8 * seen + 1.0
                pending[name] = t, np.array([x, y]), means[name]
        comparisons, pool = pooled(comparisons, pool, found)
        for name in tracks:
            seen, scores = compared[name], errors[name] + 2.0 * pool
            best = 0 if 0.9 * scores[0] <= min(scores[1:]) else 1 + int(np.argmin(scores[1:]))
            sigma = math.sqrt(2.0 / math.pi) * scores[best] / (seen + 2.0)
            out[name] = *means[name][best].tolist(), sigma
    return out


def turns(scans, side, radius, least=0.7, gap=0.3, first=10.0):
    """How often tracks turn and by how much, from scans (t, {name: (x, y, vx, vy)}) of discs in a square room.

    Whole histories are compared pair by pair. A change counts from the velocity expected or, where a wall is met within `gap`
    in steps of a tenth of a millisecond, from the mirrored one if that is less. The first scan of a track, after which it was
    not out of sight for over a second, tells no velocity.
    """
    histories = {}
    for t, tracks in scans:
        for name, motion in tracks.items():
            histories.setdefault(name, []).append((t, np.array(motion)))
    pairs = []
    for history in histories.values():
        first_scans = [i for i in range(len(history)) if i == 0 or history[i][0] - history[i - 1][0] > 1.0]
        steps = [(history[i], history[i + 1]) for i in range(len(history) - 1) if i not in first_scans]
        pairs += [(one, other) for one, other in steps if other[0] - one[0] <= gap]
    turned = []
    for (_, one), (_, other) in pairs:
        expected = [one[2:]]
        at = one[:2] + np.arange(0.0, gap, 1e-4)[:, None] * one[2:]
        outside = (at < radius) & (one[2:] < 0.0) | (at > side - radius) & (one[2:] > 0.0)
        if outside.any():
            axis = outside[outside.any(axis=1).argmax()].argmax()
            expected.append(np.where(np.arange(2) == axis, -one[2:], one[2:]))
        if (changes := [math.dist(v, other[2:]) for v in expected])[0] > least and min(changes) > least:
            turned.append(min(changes))
    return len(turned) / (first + sum(other[0] - one[0] for one, other in pairs)), sum(turned) / max(len(turned), 1)


def measured_noise(scans) -> tuple[float, float]:
    """Variances of places and velocities from scans (t, ids, xy, velocity): true medians of squared innovations and changes.

    Velocities of NaN are taken from the two places before; the squares are then divided by their mean in units of the variance.
    """
    tracks: dict[int, list] = {}
    for t, ids, xy, velocity in scans:
        for name, place, speed in zip(ids, xy, velocity):
            tracks.setdefault(int(name), []).append((t, place, speed))
    squares, changes = [], []
    for places in tracks.values():
        for (t1, x1, v1), (t2, x2, v2) in pairwise(places):
            if not np.isnan(v1[0]):
                squares.append(((x2 - x1 - (v1 + v2) / 2 * (t2 - t1)) ** 2).sum() / 4.0)
                changes.append(((v2 - v1) ** 2).sum() / 4.0)
        for (t0, x0, v0), (t1, x1, _), (t2, x2, _) in zip(places, places[1:], places[2:]):
            if np.isnan(v0[0]):
                weights = np.array([(t2 - t1) / (t1 - t0), -(t2 - t0) / (t1 - t0), 1.0])
                squares.append(((weights @ np.array([x0, x1, x2])) ** 2).sum() / (2.0 * (weights**2).sum()))
    return float(np.median(squares)) / math.log(2.0), float(np.median(changes or [0.0])) / math.log(2.0)


def bounced(state, radius, side, dt, xy, velocity, deviations) -> tuple[list[float], bool]:
    """Where a track (x, y, vx, vy) in a square hall would be after `dt` s, and whether the scan says that it has bounced.

    Its motion is followed in small steps for half as long again, and mirrored at the first side that it touches. Both futures
    are judged by the normal densities of the place and, unless it is NaN, the velocity, with these deviations.
    """
    x, v = np.array(state[:2]), np.array(state[2:])
    futures = [np.concatenate((x + v * dt, v))]
    steps = x + np.linspace(0.0, 1.5 * dt, 20_001)[:, None] * v
    outside = (steps < radius) & (v < 0.0) | (steps > side - radius) & (v > 0.0)
    if outside.any():
        first = outside.any(axis=1).argmax()
        axis = outside[first].argmax()
        mirrored = futures[0].copy()
        mirrored[axis] = 2.0 * steps[first, axis] - mirrored[axis]
        mirrored[axis + 2] *= -1.0
        futures.append(mirrored)
    measured = np.concatenate((xy, velocity))
    from scipy import stats  # takes long to import; files that need other twins of this module do without

    chances = [np.nansum(stats.norm.logpdf(measured, one, np.repeat(deviations, 2))) for one in futures]
    best = int(np.argmax(chances))
    return futures[best].tolist(), best == 1


def velocities_are_wrong(scans, span, enough, times, memory=0.995, least=0.03, most=1.0, far=0.5) -> list[bool]:
    """After each scan (t, ids, xy, velocity): whether reported velocities predicted worse than the two places before did.

    Places at least `span` s apart are compared, with how far the velocities reported between them have led; after a gap of more
    than `far` s a span begins anew.
    """
    past, errors, out = {}, [], []  # of each track: its spans, each a list of (t, place, velocity); errors: (reported, between)
    for t, ids, xy, velocity in scans:
        for name, place, speed in zip(ids, xy, velocity):
            spans = past.setdefault(int(name), [[]])
            spans[-1].append((t, place, speed))
            (start, x1, _), (last, _, _) = spans[-1][0], spans[-1][-2 if len(spans[-1]) > 1 else -1]
            if t == start or (t - start < span - 1e-6 and t - last <= far):
                continue
            led = sum(v * (later - now) for (now, _, v), (later, _, _) in pairwise(spans[-1]))
            found = (place - x1) / (t - start)
            if len(spans) > 1:
                before = spans[-2]
                known = (before[-1][1] - before[0][1]) / (before[-1][0] - before[0][0])
                both = math.dist(found, led / (t - start)), math.dist(found, known)
                if t - last <= far and not any(map(math.isnan, both)):
                    errors.append(np.minimum(both, most))
            spans.append([(t, place, speed)])
        weights = memory ** np.arange(len(errors))[::-1]
        reported, between = weights @ errors if errors else (0.0, 0.0)
        out.append(weights.sum() >= enough and reported > times * between + least * weights.sum())
    return out


def stays(scans, place=1.0, least_memory=1.0, memory=15.0, stood=0.5, still=0.2):
    """Return of each obstacle {name: (since, seen, places, then)}: the places of its stay, whose box is no longer than `place`.

    `scans` are (t, {name: (x, y, vx, vy)}). An obstacle out of sight is remembered for as long as it had stayed, or for
    `memory` s if it stood; for `least_memory` if it leaves the box with its last velocity within a second, where it is `then`.
    """
    known, box = {}, lambda places: math.dist(np.min(places, axis=0), np.max(places, axis=0))
    for t, seen in scans:
        for name, (since, last, places, then) in list(known.items()):
            least = memory if last - since >= stood and box(places) <= still else least_memory
            if t - last > (least_memory if box([*places, then]) > place else max(last - since, least)):
                del known[name]
        for name, (x, y, vx, vy) in seen.items():
            since, _, places, _ = known.get(name, (t, t, [], ()))
            places = [*places, (x, y)]
            if box(places) > place:
                since, places = t, [(x, y)]
            known[name] = since, t, places, (x + vx, y + vy)
    return known


def turn_rates(scans, memory=0.3, later=0.4, least=0.05, lost=1.0, jump=4.0):
    """Turn rates of the last scan, 0 for a straight line: whole histories, sums written out, without walls.

    A scan is (t, {name: (x, y, vx, vy)}). Returns {name: rate}. The straight line is that of the last velocity.
    """
    past, errors, pending = {}, {}, {}  # pending: (t, place, velocity, rate) of the forecast
    pool, comparisons, out = np.zeros(2), 0, {}
    for t, tracks in scans:
        found, rates = [], {}
        for name, (x, y, vx, vy) in tracks.items():
            if name in past and t - past[name][-1][0] > lost:
                del past[name], errors[name]
                pending.pop(name, None)
            history = past.setdefault(name, [])
            if history and min(abs(history[-1][1]), math.hypot(vx, vy)) > least:
                turn = np.angle(complex(vx, vy) / history[-1][1])
                if abs(turn) > jump * (t - history[-1][0]):
                    history.clear()
                    pending.pop(name, None)
            first = name not in errors
            history.append((t, complex(vx, vy)))
            weights, turned = [], []
            for (a, u), (b, v) in pairwise(history):
                weights.append((1 - math.exp(-(b - a) / memory)) * math.exp(-(t - b) / memory))
                turned.append(np.angle(v / u) / (b - a) if min(abs(u), abs(v)) > least else 0.0)
            rates[name] = rate = float(np.average(turned, weights=weights)) if weights else 0.0
            own = errors.setdefault(name, [])
            since = t - pending[name][0] if name in pending else math.inf
            if not first and since >= later - 1e-6:
                if since < 2 * later:
                    _, place, velocity, old = pending[name]
                    moments = (np.arange(2000) + 0.5) * since / 2000
                    ends = place + velocity * since, place + (velocity * np.exp(1j * old * moments)).mean() * since
                    off = np.abs(np.array(ends) - complex(x, y)) / since
                    found.append(off)
                    own.append(off)
                pending[name] = t, complex(x, y), complex(vx, vy), rate
        comparisons, pool = pooled(comparisons, pool, found)
        for name, rate in rates.items():
            straight, circle = sum((0.8**i * off for i, off in enumerate(reversed(errors[name]))), 2.0 * pool)
            out[name] = rate if circle < 0.5 * straight else 0.0
    return out


def hidden(
    place: np.ndarray, radius: float, others: list[tuple[np.ndarray, float]], eye: np.ndarray, walls: np.ndarray
) -> bool:
    """Whether a wall or another disc covers any point of the front of a disc, by samples along many lines of sight.

    `others` are places and radii of discs; `walls` are the centres of blocked squares with an edge of 1 m.
    """
    across = np.array([[0.0, -1.0], [1.0, 0.0]]) @ (place - eye) / math.dist(place, eye)
    for side in (-1.0, 0.0, 1.0):
        line = eye + np.linspace(0.0, 1.0, 2000)[:, None] * (place + side * radius * across - eye)
        if any((np.abs(line - wall).max(axis=1) < 0.5).any() for wall in walls):
            return True
    line = eye + np.linspace(0.0, 1.0, 2000)[1:-1, None] * (place - eye)
    return any((np.hypot(*(line - at).T) < size + radius).any() for at, size in others)
