"""A small hand-made episode for the tests of pictures and pages: no planner, no simulator, known numbers."""

from __future__ import annotations

import numpy as np

from antway import Decision, Grid, RobotSpec, Task, TimedPath
from antway.world.timeline import Timeline
from antway.world.trace import Outcome, Trace


def predicted(timeline: Timeline, now: float) -> np.ndarray:
    """Every disc as it moves now, for 6 s: what a decision tells of a prediction."""
    xy, velocity = timeline.at(now)
    times = np.tile([now, now + 6.0], (len(xy), 1))
    return np.column_stack((times, xy, velocity, timeline.radius)).astype(np.float32)


def sample_trace(steps: int = 150, obstacles: int = 2, scenario: str = "sample", reason: str = "") -> Trace:
    """A robot that drives along a 20 x 20 grid's diagonal, waits for a crossing disc and goes on; `steps` of 0.1 s."""
    blocked = np.zeros((20, 20), dtype=bool)
    blocked[4:9, 3:5] = blocked[10:12, 8:14] = blocked[2:5, 12:16] = blocked[14:18, 5:7] = True
    task = Task(Grid(blocked), RobotSpec(radius=0.4, v_max=1.5, sensor_range=5.0), (0.5, 0.5), (18.5, 18.5))
    t = np.arange(steps + 1) * 0.1
    share = np.clip((t / t[-1]) * 1.25 - 0.25 * (t > 0.5 * t[-1]), 0, 1)
    share = np.maximum.accumulate(share)
    xy = np.column_stack((0.5 + 18 * share, 0.5 + 18 * share**1.3))
    velocity = np.vstack((np.zeros((1, 2)), np.diff(xy, axis=0) / 0.1))
    trajectories = []
    for k in range(obstacles):
        a, b = np.array([17.5 - k % 7, 2.0 + 1.7 * (k % 9)]), np.array([2.5 + k % 5, 9.0 + 0.4 * k])
        trajectories.append((np.array([0.0, t[-1] / 2, t[-1]]), np.array([a, b, a])))
    timeline = Timeline.of(list(range(1, obstacles + 1)), [0.5] * obstacles, trajectories)
    places = timeline.places(t)
    sensed = np.hypot(*(places - xy[:, None]).transpose(2, 0, 1)) < 5.0 if obstacles else np.zeros((steps + 1, 0), bool)
    decisions = [(0, Decision("follow", "The way is free: on along the global path."))]
    temperature = np.exp(-0.05 * ((np.arange(12)[:, None] - np.arange(12)[None, :]) ** 2)).astype(np.float32)
    for step in range(steps // 3, 2 * steps // 3):
        here, there = xy[step], xy[min(step + 30, steps)]
        path = TimedPath(t[step] + np.array([0.0, 1.0, 3.0]), np.array([here, (here + there) / 2 + [0.6, -0.6], there]))
        row, col = int(max(here[1] - 2, 0)), int(max(here[0] - 2, 0))
        decisions.append(
            (
                step,
                Decision(
                    "avoid",
                    reason or "Crossing from the right with obstacle 1, closest in 1.8 s at 0.1 m: pass behind, +0.4 s.",
                    obstacle=1,
                    encounter="crossing-right",
                    time_to_closest=1.8,
                    distance_at_closest=0.1,
                    local_target=(float(there[0]), float(there[1])),
                    path=path,
                    alternatives=(("pass behind", 0.4), ("wait", 1.1)),
                    pheromone=(row, col, temperature * (1 + step % 3)),
                    predicted=predicted(timeline, t[step]),
                ),
            )
        )
    decisions.append((2 * steps // 3, Decision("follow", "Back on the global path.")))
    return Trace(
        task=task,
        policy="paper",
        seed=7,
        scenario=scenario,
        t=t,
        xy=xy,
        velocity=velocity,
        heading=np.arctan2(velocity[:, 1], velocity[:, 0]),
        command=velocity[1:].copy(),
        timeline=timeline,
        sensed=sensed,
        decisions=tuple(decisions),
        cycle_ms=np.full(steps, 0.4),
        outcome=Outcome.REACHED,
        reason="At the goal.",
    )
