"""Obstacles that have stopped on the map, so that a plan has to lead around them as around walls."""

from __future__ import annotations

import math
from collections.abc import Set
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from antway.grid import Grid
from antway.world.policy import Tracks

WALL_AFTER = 3.0  # s; an obstacle that has stood for this time counts as a wall
FORGOTTEN_AFTER = 30.0  # s; an obstacle that has not been sensed for this time is forgotten
_DRIFT = 0.2  # m; an obstacle that is farther from where it came to a stand has moved; noise of places is less


class Sighting(NamedTuple):
    """What the robot has sensed of an obstacle."""

    since: float  # s; when it came to a stand, or `seen` if it moved
    seen: float  # s; time of the last observation
    x: float  # m; its place at `since`
    y: float  # m
    radius: float  # m


class StandingObstacles:
    """What the robot has sensed of each obstacle, by the id of its track, and since when it has been standing."""

    def __init__(self) -> None:
        self.sightings: dict[int, Sighting] = {}

    def observe(self, tracks: Tracks, now: float) -> None:
        """Take in the tracks that are known at time `now`, s."""
        for k in range(len(tracks)):
            number, (x, y) = int(tracks.id[k]), tracks.xy[k].tolist()
            last = self.sightings.get(number)
            since = now
            if last is not None and math.dist((x, y), (last.x, last.y)) <= _DRIFT:
                since, x, y = last.since, last.x, last.y
            self.sightings[number] = Sighting(since, now, x, y, float(tracks.radius[k]))
        self.sightings = {number: one for number, one in self.sightings.items() if now - one.seen < FORGOTTEN_AFTER}

    def walls(self) -> dict[int, float]:
        """Return the ids of the obstacles that have stood for so long that they count as walls, and since when, s."""
        return {number: one.since for number, one in self.sightings.items() if one.seen - one.since >= WALL_AFTER}

    def block(self, grid: Grid, numbers: Set[int], margin: float) -> Grid:
        """Return `grid` with cells blocked whose centre is within the radius plus `margin` m of one of these obstacles."""
        if not numbers:
            return grid
        rows, cols = np.indices(grid.shape)
        blocked = grid.blocked.copy()
        for one in map(self.sightings.__getitem__, numbers):
            row, col = grid.to_points([(one.x, one.y)])[0]
            blocked |= np.hypot(rows - row, cols - col) < (one.radius + margin) / grid.resolution
        return replace(grid, blocked=blocked)
