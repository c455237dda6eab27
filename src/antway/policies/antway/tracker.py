"""What policy antway knows of the tracks in one episode: filtered estimates, and how noisy the sensor is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from antway.kernels.base.arrays import Bools, Floats, Ints
from antway.kernels.base.jit import call, entry
from antway.kernels.base.records import Terrain
from antway.kernels.tracking import averages, changes, kalman, noise, reported
from antway.kernels.tracking.predict import ID, RADIUS, SIGMA, SIGMA_V, VX, VY, X, Y
from antway.kernels.tracking.scan import Known, TrackEstimates, take_in
from antway.kernels.tracking.table import Table, make_table, rows_in_use
from antway.world.policy import XY, Observation, Tracks

MOST_ROWS = 256  # tracks that tables hold
AGILITY = 1.0  # m/s^2; standard deviation of the acceleration that the filter expects of obstacles
_NEAR = 0.8  # m; a track without an id is matched if it is nearer than this to its predicted place
FIRST_OWN_ID = 2**52  # tracks without an id get one from here on; up to 2**53 floats hold all whole numbers
_LARGEST_ID = 2.0**63 - 1024.0  # the largest float that is a whole number of 64 bits
_MEASURED = 0.9 * kalman.UNKNOWN**2  # m^2/s^2; a measured velocity is known better than one that is not measured
_UNDERSTATED = 4.0  # 1; a sensor whose innovations show a variance of places this many times the stated one understates it
_NOISY = 1e-4  # m^2; above this median of the squared innovations, the guard is given estimates instead of measurements


class Tracker:
    """Filters the tracks of one episode.

    If `strict`, covariances are taken as stated. Otherwise those of measurements are scaled down to what innovations show.
    """

    def __init__(self, strict: bool = False) -> None:
        self._strict = strict
        self.table = make_table(MOST_ROWS, kalman.COLUMNS, ID)
        self._known = Known(
            self.table,
            make_table(MOST_ROWS, changes.COLUMNS),
            np.zeros(3),
            make_table(MOST_ROWS, averages.COLUMNS),
            np.zeros(averages.POOL),
        )
        # What is known after the last scan, and of it the estimates of the tracks there are.
        self.tracks = TrackEstimates(
            np.zeros((MOST_ROWS, 8)), np.zeros(MOST_ROWS, np.bool_), np.zeros((MOST_ROWS, 4)), np.zeros((MOST_ROWS, 8))
        )
        self.estimates = self.tracks.estimates[:0]
        self.beyond_edge = False  # whether the last scan shows an obstacle beyond an edge of the map
        # For kernels/tracking/noise.py.
        self._measured, self._noise = make_table(MOST_ROWS, noise.COLUMNS), np.zeros(noise.STATE)
        # The measurements last compared and their errors, for each span of kernels/tracking/reported.py.
        self._compared = make_table(MOST_ROWS, reported.COLUMNS), make_table(MOST_ROWS, reported.COLUMNS)
        self._errors = np.zeros((2, 3))
        self._variance = np.zeros((MOST_ROWS, 2))  # of the last scan
        self._has_velocities = True  # whether the sensor measured those of all tracks in the last scan
        self.doubts_velocities = False  # whether the reported velocities are not used, because they do not predict places
        self._forget()
        self._next_id = FIRST_OWN_ID
        # The kernel is loaded now, because to compile it when places turn out to be noisy would delay that cycle by 0.2 s.
        entry(kalman.raise_variances, *self.table[:2], self._largest, self._largest)

    def corrected(self, seen: Observation) -> Observation:
        """Return the observation with an id for each track (`with_ids`), and without velocities that are wrong.

        If it tells that nothing was sensed yet, though something was, its scan is the last one.
        """
        if seen.stamp == -math.inf and len(self.estimates):
            seen = replace(seen, stamp=float(self.last_seen.max()))
        t = seen.sensed_at
        if len(seen.tracks) > MOST_ROWS:
            seen = replace(seen, tracks=nearest(seen.tracks, seen.xy))
        tracks, self._next_id = with_ids(seen.tracks, t, self.table, self._next_id)
        if tracks.covariance is None:
            wrong = call(reported.wrong_in_spans, self._compared, self._errors, t, tracks.id, tracks.xy, tracks.velocity)
            if any(wrong) != self.doubts_velocities:
                self.doubts_velocities = any(wrong)
                self._forget()
                if wrong[0]:  # found from scan to scan, which shows only where places are exact
                    self._noise[noise.PLACE] = noise.LEAST
            if self.doubts_velocities:
                tracks = replace(tracks, velocity=np.full(tracks.velocity.shape, math.nan))
        return seen if tracks is seen.tracks else replace(seen, tracks=tracks)

    def _forget(self) -> None:
        """Forget what was learnt from velocities, such as that places are wrong to which they do not lead."""
        rows = rows_in_use(self.table)  # places are known again after a scan, and velocities after two
        rows[:, [VX, VY, kalman.P12]], rows[:, [kalman.P11, kalman.P22]] = 0.0, kalman.UNKNOWN**2
        self._known.averages.used[0], self._known.compared.used[0], self._measured.used[0] = 0, 0, 0
        self.fastest = 0.0  # m/s; speed of the fastest track seen
        self._noise[:] = 0.0
        self._largest = np.zeros(2)  # the largest variances that innovations have shown, if places were not nearly exact
        self._known.pool[:], self._known.turns[:] = 0.0, (changes.FIRST_SECONDS, 0.0, 0.0)

    def update(
        self,
        tracks: Tracks,
        t: float,
        terrain: Terrain,
        xy: XY = (0.0, 0.0),
        sensor_range: float = 0.0,
        restart: bool = False,
    ) -> None:
        """Update what is known with a scan at time `t` s.

        False alarms within `sensor_range` m of the robot at `xy` m are forgotten. Averages of velocities begin anew where
        somebody stops, sets out or turns, if `restart`; if strict, velocities are not averaged.
        """
        scan = tracks.id, tracks.xy, tracks.velocity, tracks.radius, self._variances(tracks, t)
        where = float(t), scan, xy, sensor_range, AGILITY, not self._strict, restart
        found = call(take_in, self._known, terrain, *where, self.tracks)
        known, fastest, self._has_velocities, self.beyond_edge = found
        self.estimates, self.fastest = self.tracks.estimates[:known], max(self.fastest, fastest)

    @property
    def last_seen(self) -> Floats:
        """When each of the tracks was last seen, float64[K], s."""
        return self.table.rows[: len(self.estimates), kalman.T].copy()

    @property
    def turns(self) -> tuple[float, float]:
        """How often tracks turn, 1/s, and by how much on average, m/s."""
        seconds, number, change = self._known.turns.tolist()
        return number / seconds, change / max(number, 1.0)

    def _variances(self, tracks: Tracks, t: float) -> Floats:
        """Return the variances of places (m^2) and velocities (m^2/s^2) as the filter takes them, float64[K, 2]."""
        variance = self._variance[: len(tracks)]
        if tracks.covariance is None:
            variance[:] = found = self._shown(tracks, t)
            if found[0] > noise.EXACT:
                self._doubt(found)
            return variance
        # A filter correlates place and velocity.
        filtered = tracks.covariance[:, :2, 2:].any(axis=(1, 2))
        variance[:, 0], variance[:, 1] = tracks.variances(0), tracks.variances(2)
        if not self._strict and len(tracks) and not filtered.any():
            stated = float(np.median(variance[:, 0]))
            self._noise[noise.PLACE] = self._noise[noise.PLACE] or noise.MEDIAN * stated
            found = self._shown(tracks, t)
            if found[0] > max(noise.EXACT, _UNDERSTATED * stated):
                variance[:] = np.maximum(variance, found)
                self._doubt(found)
            else:  # many trackers state errors that are far too large; what a filter shows is smoother than its errors
                variance *= np.minimum(found[0] / np.maximum(variance[:, :1], 1e-12), 1.0)
            variance[:, 1] = np.minimum(variance[:, 1], _MEASURED)
        variance[filtered] *= -1.0
        return variance

    def _shown(self, tracks: Tracks, t: float) -> tuple[float, float]:
        """Return the variances of measured places (m^2) and velocities (m^2/s^2) that innovations show."""
        rows, used, _ = self._measured
        return noise.measured_noise(rows, used, self._noise, t, tracks.id, tracks.xy, tracks.velocity)

    def _doubt(self, found: tuple[float, float]) -> None:
        """Doubt estimates that were made while measurements were taken to be better than these variances."""
        worse = np.maximum(self._largest, found)
        if (worse > self._largest).any():
            call(kalman.raise_variances, *self.table[:2], self._largest, worse)
            self._largest = worse

    def for_guard(self, seen: Observation) -> Observation:
        """Return the observation with the tracks that the guard is given: measurements if they are exact, else estimates.

        A strict guard keeps the measurements, because estimates from wrong velocities, or of obstacles that turn, would drift
        away from them; without a stated covariance, they get the one that their innovations show.
        """
        noisy, covariance = self._noise[noise.PLACE] > _NOISY, seen.tracks.covariance
        if self._strict:
            return self._with_noise(seen) if covariance is None and noisy else seen
        if covariance is not None or noisy or not self._has_velocities:
            return self._as_estimated(seen)
        return seen

    def _with_noise(self, seen: Observation) -> Observation:
        n = len(seen.tracks)
        covariance = np.zeros((n, 4, 4))
        covariance[:, 0, 0] = covariance[:, 1, 1] = self._variance[0, 0]  # that of all tracks
        return replace(seen, tracks=replace(seen.tracks, covariance=covariance))

    def _as_estimated(self, seen: Observation) -> Observation:
        """Return the observation with the estimates as tracks; velocities are NaN where the filter knows none."""
        e = self.estimates
        velocity = np.where(e[:, SIGMA_V, None] < kalman.UNKNOWN, e[:, VX : VY + 1], math.nan)
        covariance = np.zeros((len(e), 4, 4))
        covariance[:, 0, 0] = covariance[:, 1, 1] = e[:, SIGMA] ** 2
        covariance[:, 2, 2] = covariance[:, 3, 3] = e[:, SIGMA_V] ** 2
        return replace(seen, tracks=Tracks(ids_of(e), e[:, :2], velocity, e[:, RADIUS], covariance))


def nearest(tracks: Tracks, xy: XY) -> Tracks:
    """Return the tracks nearest to the place `xy`, m, in their order: half of MOST_ROWS, as tables hold lost tracks besides."""
    at = np.sort(np.argsort(np.hypot(*(tracks.xy - xy).T), kind="stable")[: MOST_ROWS // 2])
    covariance = None if tracks.covariance is None else tracks.covariance[at]
    return Tracks(tracks.id[at], tracks.xy[at], tracks.velocity[at], tracks.radius[at], covariance)


def ids_of(estimates: Floats) -> Ints:
    """Return the ids of tracks, which tables hold as floats; the largest whole numbers become one that both can hold."""
    return np.minimum(estimates[:, ID], _LARGEST_ID).astype(np.int64)


def with_ids(tracks: Tracks, t: float, table: Table, first: int) -> tuple[Tracks, int]:
    """Return the tracks seen at time `t` s with an id for each: that of the nearest known track, or else a new one.

    An id that the sensor gives counts, unless its track was expected far from there and another known track near: then the
    sensor has swapped ids. Tracks with the id -1 get another one. Known tracks, in `table` (kernels/tracking/kalman.py), that
    have a track already are not considered. New ids are the least from `first` on that nobody has; the second result is from
    where on they are counted the next time.
    """
    if first <= FIRST_OWN_ID and not kalman.needs_ids(*table[:2], t, tracks.id, tracks.xy):
        return tracks, first
    rows = rows_in_use(table)
    age = t - rows[:, kalman.T]
    place = rows[:, X : Y + 1] + rows[:, VX : VY + 1] * age[:, None]
    gap = np.hypot(*(place[:, None] - tracks.xy).transpose(2, 0, 1))
    given = np.where(_doubtful(gap, rows[:, ID, None] == tracks.id), -1, tracks.id)
    ids, known = given.copy(), ids_of(rows)
    gap[np.isin(rows[:, ID], given)] = math.inf
    gap[:, given >= 0] = math.inf
    while gap.size and gap.min() < _NEAR:  # the nearest pair first
        i, k = np.unravel_index(gap.argmin(), gap.shape)
        ids[k] = known[i]
        gap[i], gap[:, k] = math.inf, math.inf
    ids = np.where((ids < 0) & ~np.isin(tracks.id, ids), tracks.id, ids)  # a doubtful id that nobody else got
    new = np.flatnonzero(ids < 0)
    taken = np.append(ids, rows[:, ID])  # floats, as ids in the table are
    ids[new] = np.setdiff1d(first + np.arange(float(len(taken))), taken)[: len(new)]
    return replace(tracks, id=ids), int(ids[new].max(initial=first - 1)) + 1


def _doubtful(gap: Floats, same: Bools) -> Bools:
    """Tell of each track of a scan whether its id is doubtful, bool[K].

    It is if no known track has that id, or if that track was expected more than `kalman.FAR` away and another one half as far
    at most: a known track is nearer to this place, or a track of the scan to the place expected. `gap`, float64[M, K], tells
    how far each track of the scan is from where each known track was expected, m, and `same`, whether both have the same id.
    """
    own, others = np.where(same, gap, math.inf), np.where(same, math.inf, gap)
    known = others.min(axis=0, initial=math.inf)
    seen = np.where(same, others.min(axis=1, initial=math.inf)[:, None], math.inf).min(axis=0, initial=math.inf)
    own = own.min(axis=0, initial=math.inf)
    doubtful: Bools = ~same.any(axis=0) | (own > kalman.FAR) & (np.minimum(known, seen) <= 0.5 * own)
    return doubtful
