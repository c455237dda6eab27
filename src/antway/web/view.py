"""A policy in a session: its episode, its observations, and what of both was sent to the page."""

from __future__ import annotations

import copy
import math
from bisect import bisect_left
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.policies.paper.tubes import Tubes
from antway.view.pages import faint_scale, rounded, to_base64
from antway.world.ants import ShowsAnts
from antway.world.episode import Episode
from antway.world.policy import Decision, Observation, Policy
from antway.world.scenario import Scenario

Message = dict[str, Any]

HORIZON = 3.0  # s; time for which predictions are shown
_GROWTH = 0.03  # m/s; growth of the tubes of policy paper
_QUANTILE = 1.645  # number of standard deviations added to the radius of an obstacle that is sensed with noise
_SHADES = 40_000  # limit of cells of pheromone in a frame
_EDGES = 400  # limit of the ants' trails in a frame
_KNOTS = 300  # limit of knots of a planned path in a frame
MAX_SEEN = 1000  # limit of moments for which observations are kept
_COLUMNS = 7  # see `_packed`
_ROWS = 300  # limit of new rows of the driven path in a frame


def _packed(seen: Observation | None) -> bytes:
    """Return the parts of an observation that the page may need later, compactly, as hundreds of tabs keep hundreds of them.

    These are rows of seven numbers: its time and the sensor's; then place, velocity, radius and both variances of each track.
    """
    if seen is None:
        return b""
    tracks, rows = seen.tracks, np.zeros((len(seen.tracks) + 1, _COLUMNS))
    rows[0, :2] = seen.t, seen.sensed_at
    rows[1:, :2], rows[1:, 2:4], rows[1:, 4] = tracks.xy, np.nan_to_num(tracks.velocity, nan=0.0), tracks.radius
    if tracks.covariance is not None:
        rows[1:, 5], rows[1:, 6] = tracks.variances(0), tracks.variances(2)
    return rows.tobytes()


class Moment(NamedTuple):
    """What is kept of each moment besides the episode's record."""

    seen: bytes  # the observation, see `_packed`
    clearance: float  # m; the smallest so far
    visited: tuple[tuple[int, bool], ...]  # stops, and whether each was reached too late
    order: tuple[int, ...]


class Look(NamedTuple):
    """The next control cycle, with at most `cycles` ant cycles."""

    cycles: int
    done: bool  # whether the ants finished by themselves, so that the control cycle will have the same result
    decision: Decision
    policy: Policy  # a copy of the policy after this


class View:
    """A policy at work, and what of it was sent to the page."""

    def __init__(self, scenario: Scenario, policy: str) -> None:
        self.episode = Episode(scenario, policy)
        tour = self.episode.tour
        self.policy = self.episode.policy if tour is None else tour.policy
        if isinstance(self.policy, ShowsAnts):  # own memory would take megabytes for each tab
            self.policy.use_common_memory()
        self.sent = 0  # number of rows of the record that were sent
        self.decision: Decision | None = None
        self.look: Look | None = None  # a look inside the next cycle
        self.idle = ""  # why no ants take part in the next cycle
        self.moments = [self._moment()]

    def step(self) -> None:
        """Play one control cycle."""
        self.look, self.idle = None, ""
        if self.episode.outcome is None:
            self.episode.step()
            self.moments.append(self._moment())
            if len(self.moments) > MAX_SEEN:
                self.moments[-MAX_SEEN - 1] = self.moments[-MAX_SEEN - 1]._replace(seen=b"")

    def added(self) -> None:
        """Record that a stop was added, after which the page gets a new scene and everything is sent again."""
        self.look, self.idle, self.sent, self.decision = None, "", 0, None
        self.moments[-1] = self._moment()

    def _moment(self) -> Moment:
        tour, clearance = self.episode.tour, self.episode.stage.clearance
        if tour is None:
            return Moment(_packed(self.episode.seen), clearance, (), ())
        rounds = tour.rounds
        visited = tuple((visit.stop, rounds.lateness(visit) > 0) for visit in rounds.visits)
        return Moment(_packed(self.episode.seen), clearance, visited, tuple(tour.order))

    def look_inside(self) -> bool:
        """Run one more ant cycle of the next control cycle on a copy; tell whether there was one."""
        if self.episode.outcome is not None or (self.look is not None and self.look.done):
            return False
        if not isinstance(self.policy, ShowsAnts):
            self.idle = "This policy has no ants."
            return False
        cycles = 1 if self.look is None else self.look.cycles + 1
        shared = (self.episode.scenario, self.episode.stage.task, self.episode.stage.timeline)  # constant: they need no copies
        trial, ants = copy.deepcopy((self.episode, self.policy), {id(thing): thing for thing in shared})
        step = ants.step_ants(cycles, trial.step)
        self.look, self.idle = (None, step.idle) if step.idle else (Look(cycles, step.done, step.decision, ants), "")
        return self.look is not None

    def frame(self, views: int, at: int) -> Message:
        """Return the moment after `at` control cycles, or the last one, and everything new since the last frame."""
        episode, stage = self.episode, self.episode.stage
        n = min(at, episode.steps)
        moment, latest = self.moments[n], n == episode.steps
        places, velocities = stage.timeline.at(float(stage.t[n]))
        sensed = stage.sensed[max(n - 1, 0)]
        start, end = self.sent, min(episode.steps + 1, self.sent + _ROWS)
        self.sent = end
        look = self.look
        path, stand = self._braking(n)
        record: Message = {
            "at": n,
            "t": short(stage.t[n]),
            "robot": [short(v) for v in (*stage.xy[n], stage.heading[n])],
            "speed": short(math.hypot(*stage.velocity[n])),
            "braking": [short(path), short(math.atan2(stage.velocity[n, 1], stage.velocity[n, 0])), short(stand)],
            "obstacles": [
                [short(v) for v in (*place, *velocity)] + [int(seen)]
                for place, velocity, seen in zip(places, velocities, sensed)
            ],
            "tubes": self._tubes(moment.seen, float(stage.t[n])),
            "from": start,
            "trail": short_rows(stage.xy[start:end]),
            "ms": [short(v) for v in stage.cycle_ms[max(start - 1, 0) : end - 1]],
            "clearance": short(moment.clearance),
            "outcome": episode.outcome.value if latest and episode.outcome is not None else None,
            "ending": episode.reason[:400],
            "ants": None if look is None else [look.cycles, look.done],
            "idle": self.idle,
        }
        if episode.tour is not None:
            record["visited"], record["order"] = [list(visit) for visit in moment.visited], list(moment.order)
        made = bisect_left(episode.decisions, n, key=lambda one: one[0])  # decisions made before this moment
        decision = look.decision if look is not None else episode.decisions[made - 1][1] if made else None
        if decision is not self.decision:
            self.decision = decision
            policy = self.policy if look is None else look.policy
            record["decision"] = None if decision is None else _decision(decision, views)
            laid = latest and decision is not None and decision.pheromone is not None  # earlier trails are not kept
            record["trails"] = short_rows(edges(policy, _EDGES // views)) if laid else []
        return record

    def _braking(self, n: int) -> tuple[float, float]:
        """Return distance in m and time in s until the robot stands, if it brakes after one more control period."""
        spec, stage = self.episode.stage.task.robot, self.episode.stage
        speed = math.hypot(*stage.velocity[n])
        if speed < 1e-6:
            return 0.0, 0.0
        if spec.dynamics != "steps":
            after, slowing = spec.latency + spec.dt, speed / spec.braking
            return speed * (after + slowing / 2), after + slowing
        periods = 1 if math.isinf(spec.a_max) else max(1, math.ceil(speed / (spec.a_max * spec.dt) - 1e-9))
        slower = 0.0 if periods == 1 else spec.a_max * spec.dt * periods * (periods - 1) / 2
        return (speed * periods - slower) * spec.dt, periods * spec.dt

    def _tubes(self, packed: bytes, now: float) -> list[list[Any]]:
        """Return [radius in m, growth in m/s, [[time from now, x, y], ...]] of each obstacle in the observation."""
        rows = np.frombuffer(packed).reshape(-1, _COLUMNS)
        if len(rows) < 2:
            return []
        t, seen_at = rows[0, :2].tolist()
        tubes = Tubes.predict(t, seen_at, rows[1:, :5], self.episode.stage.task.grid, HORIZON + now - t)
        result: list[list[Any]] = []
        for k, (body, *variances) in enumerate(rows[1:, 4:].tolist()):
            t, xy = tubes.knots(k)
            times = np.unique(np.concatenate(([now], t[(t > now) & (t < now + HORIZON)], [now + HORIZON])))
            path = np.column_stack((times - now, *(np.interp(times, t, xy[:, i]) for i in (0, 1))))
            wide, faster = (_QUANTILE * math.sqrt(max(variance, 0.0)) for variance in variances)
            result.append([short(body + wide), short(_GROWTH + faster), short_rows(path)])
        return result


def edges(policy: Policy, most: int) -> NDArray[np.float64]:
    """Return the strongest trails of a policy's ants, float64[n, 5]: both ends (x, y, x, y) in m, and relative strength."""
    if not isinstance(policy, ShowsAnts):
        return np.empty((0, 5))
    here, there, amount = policy.trails()
    if not len(amount):
        return np.empty((0, 5))
    best = np.argsort(-amount, kind="stable")[:most]
    best = best[amount[best] > 0.05 * amount[best[0]]]
    return np.column_stack((here[best], there[best], amount[best] / amount[best[0]]))


def _decision(decision: Decision, views: int) -> Message:
    path = None if decision.path is None else decision.path.xy
    if path is not None and len(path) > _KNOTS:
        path = path[np.linspace(0, len(path) - 1, _KNOTS).astype(np.int64)]
    colony = None
    if decision.history is not None and len(decision.history):
        best, _, arrived, _ = decision.history[-1]
        colony = [len(decision.history), short(best), short(arrived)]
    pheromone = None
    if decision.pheromone is not None:
        row, col, amount = decision.pheromone
        pheromone = {"row": row, "col": col, **shades(amount, _SHADES // views)}
    return {
        "action": decision.action,
        "reason": decision.reason[:400],
        "obstacle": None if decision.obstacle is None else int(decision.obstacle),
        "encounter": decision.encounter,
        "closest": [short(decision.time_to_closest), short(decision.distance_at_closest)],
        "target": None if decision.local_target is None else [short(v) for v in decision.local_target],
        "path": None if path is None else short_rows(path),
        "alternatives": [[name[:80], cost] for name, cost in decision.weighed()[:8]],
        "gap": short(decision.gap),
        "guard": decision.guard,
        "colony": colony,
        "pheromone": pheromone,
    }


def shades(amount: NDArray[Any], most: int) -> Message:
    """Return amounts by cell in 16 shades by square root, two in a byte; beyond `most` cells the maximum of each block."""
    height, width = amount.shape
    block = max(1, math.ceil(math.sqrt(height * width / most)))
    rows, cols = -(-height // block), -(-width // block)
    padded = np.full((rows * block, cols * block), float(amount.min()), np.float32)
    padded[:height, :width] = amount
    coarse = padded.reshape(rows, block, cols, block).max(axis=(1, 3))
    levels = np.round(15 * faint_scale(coarse)).astype(np.uint8).ravel()
    if len(levels) % 2:
        levels = np.append(levels, np.uint8(0))
    data = to_base64(levels[::2] | (levels[1::2] << 4), "u1")
    return {"height": rows * block, "width": cols * block, "rows": rows, "cols": cols, "shades": data}


def short_rows(rows: Iterable[Iterable[float]]) -> list[list[float | None]]:
    """Return rows of numbers with three decimal places for JSON."""
    return [[short(value) for value in row] for row in rows]


def short(value: float) -> float | None:
    """Return a number with three decimal places for JSON; None if it is not finite."""
    return rounded(value, 3)
