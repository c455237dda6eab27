"""How well recorded tracks are predicted: errors compared with constant velocity, and the coverage of the tubes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.arena.environments import read_tracks, walks
from antway.errors import BadScenario
from antway.kernels.tracking.averages import COLUMNS, POOL, averaged
from antway.kernels.tracking.predict import ID, SIGMA_V, VX, VY, X, Y
from antway.kernels.tracking.prediction_error import LATER
from antway.kernels.tracking.table import make_table

Floats = NDArray[np.float64]
HORIZONS = (1.0, 2.0, 4.8)  # s; the literature uses 4.8 s, in steps of 0.4 s
TIMES = (0.5, 1.0, 2.0, 4.0)  # s; times at which tubes are tested
CHANCES = (0.05, 0.2)
PAST = 0.8  # s; length of a record that is observed before the first prediction
STEP = 0.4  # s; step of the times that count in the mean error, and of constant velocity, as in the literature
# Fitted to the recordings eth, zara01, students01 (Pellegrini 2009, Lerner 2007) and citr (Yang 2019), see docs/experiments.md.
PEOPLE_DENSITY = 0.01  # m^2/s^3; spectral density of the white acceleration of people
PEOPLE_DOF = 3.0  # 1; degrees of freedom of the distribution of people's prediction errors
_ADAPTS = 0.02  # 1; step size with which the logarithm of the tubes' width is adapted after each prediction
_MOST = 4.0  # 1; by no more than this does it change before the predictions that wait for their outcome are judged
_OWN = 0.5  # 1; share of the squared velocity error that comes from the estimate and not from the acceleration


@dataclass(frozen=True, slots=True)
class Forecast:
    """How well a recording was predicted: mean errors (horizon in s, error in m, error of constant velocity in m)."""

    cases: int  # number of predictions: for each track at each instant of its record after the first PAST s
    ade: Sequence[tuple[float, float, float]]  # over all times up to the horizon, every STEP s
    fde: Sequence[tuple[float, float, float]]  # at the horizon
    outside: Sequence[tuple[float, float, float]]  # chance, time in s, and share of tracks that were outside their tubes then


def forecast(file: str, *, factor: float = 1.0) -> Forecast:
    """Predict every track of a recording at every instant from the record up to that time.

    Parameters
    ----------
    file : str
        As for the suite `tracks:FILE`.
    factor : float
        Initial factor of the fitted widths of tubes, > 0; the right widths are learnt from then on.

    Raises
    ------
    BadParameter
        For a factor out of range.
    BadScenario
        For a file that cannot be read, or without a track of PAST + 1 s. What longer tracks would tell is NaN.
    """
    factor = checks.number("factor", factor, low=0.0, open_low=True)
    walkers = walks(read_tracks(file), file)
    now, rows, last = _estimates(walkers)
    counted = np.arange(1, round(HORIZONS[-1] / STEP) + 1) * STEP  # of which one may differ from a horizon by rounding
    instants = np.unique(np.round([*counted, *HORIZONS, *TIMES], 9))
    truth = np.full((len(now), len(instants), 2), np.nan)
    for name, walk in enumerate(walkers):
        mine = rows[:, ID] == name
        for i, later in enumerate(instants):
            t = now[mine] + later
            inside = t <= walk[-1, 0] + 1e-9
            place = np.column_stack([np.interp(t, walk[:, 0], walk[:, k]) for k in (1, 2)])
            truth[mine, i] = np.where(inside[:, None], place, np.nan)
    if not np.isfinite(truth[:, np.argmin(np.abs(instants - HORIZONS[0]))]).any():
        raise BadScenario("tracks", len(now), f"at least one track of {PAST + 1.0:g} s", where=file)
    own, constant = (
        np.hypot(*np.moveaxis(rows[:, None, (X, Y)] + v[:, None] * instants[None, :, None] - truth, -1, 0))
        for v in (rows[:, (VX, VY)], last)
    )
    ade, fde, outside = [], [], []
    for horizon in HORIZONS:
        i = int(np.argmin(np.abs(instants - horizon)))
        whole = np.isfinite(own[:, i])
        upto = (instants <= horizon + 1e-9) & (np.abs(instants / STEP - np.round(instants / STEP)) < 1e-9)
        ade.append((horizon, _mean(own[whole][:, upto]), _mean(constant[whole][:, upto])))
        fde.append((horizon, _mean(own[whole, i]), _mean(constant[whole, i])))
    for chance in CHANCES:
        for time in TIMES:
            i = int(np.argmin(np.abs(instants - time)))
            whole = np.isfinite(own[:, i])
            radius = np.array([tube_radius(people_variance(s, time), chance, PEOPLE_DOF) for s in rows[whole, SIGMA_V]])
            outside.append((chance, time, _mean(left_tubes(now[whole], own[whole, i], radius, time, chance, factor))))
    return Forecast(len(now), ade, fde, outside)


def left_tubes(now: Floats, error: Floats, radius: Floats, ahead: float, chance: float, factor: float) -> NDArray[np.bool_]:
    """Tell which obstacles left their tubes, bool[N]; a share of `chance` is to leave.

    Predictions are made at the times `now`, float64[N], s, which do not decrease. `error` and `radius`, float64[N], are the
    error of each `ahead` s later and the fitted radius of its tube, m. A tube is as wide as fitted times a factor > 0 that is
    learnt from all tracks together (`learnt_factor`), where each prediction counts from its time on.
    """
    out, due = np.zeros(len(now), np.bool_), 0
    for i in range(len(now)):
        while now[due] + ahead <= now[i] + 1e-9:
            factor = learnt_factor(factor, bool(out[due]), chance, i - due)
            due += 1
        out[i] = error[i] > factor * radius[i]
    return out


def place_variance(p11: float, p12: float, p22: float, density: float, t: float) -> float:
    """Return the variance of a track's place along one axis `t` s after its estimate, m^2.

    `p11` and `p22` are the variances of place (m^2) and velocity (m^2/s^2), and `p12` is their covariance (m^2/s). White
    acceleration of this spectral density, m^2/s^3, changes the velocity (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-4).
    """
    return p11 + 2.0 * t * p12 + t * t * p22 + density * t * t * t / 3.0


def tube_radius(variance: float, chance: float, dof: float) -> float:
    """Return the radius of the disc around a predicted place outside of which the track is with probability `chance`, m.

    The error has this variance, m^2, along each axis, and Student's t distribution in two dimensions with `dof` degrees of
    freedom: P(r > R) = (1 + R^2 / (dof variance))^(-dof / 2), which tends to the normal exp(-R^2 / (2 variance)). People mostly
    keep their velocity and turn now and then, so their errors have heavier tails than a normal distribution.
    """
    if dof == math.inf:
        return math.sqrt(-2.0 * math.log(chance) * variance)
    return math.sqrt(dof * (chance ** (-2.0 / dof) - 1.0) * variance)


def people_variance(sigma_v: float, t: float) -> float:
    """Return the variance of a person's place along one axis `t` s from now, m^2.

    `sigma_v` is the standard deviation along one axis of the velocity error over LATER s, m/s.
    """
    own = max(_OWN * sigma_v * sigma_v - PEOPLE_DENSITY * LATER / 3.0, 0.0)
    return place_variance(1e-4, 0.0, own, PEOPLE_DENSITY, t)


def learnt_factor(factor: float, left: bool, chance: float, waiting: int) -> float:
    """Return the factor for the radii of tubes after one more prediction; `left` tells whether the track left its tube.

    A share of `chance` in (0, 1) may leave; `waiting` > 0 predictions were made since this one, with factors that did not know
    its outcome. The logarithm of the factor rises by s (1 - chance) or falls by s chance, where s = min(0.02, 4 / `waiting`).
    Over N predictions, the share that leaves its tube then differs from `chance` by at most ln(highest / lowest factor) /
    (s N), however people move (Gibbs, Candes: Adaptive conformal inference under distribution shift, NeurIPS 2021). In a crowd
    that is recorded 25 times a second thousands of predictions wait: with 0.02 for each of them the factor swings by e^20 and
    more.
    """
    return factor * math.exp(min(_ADAPTS, _MOST / waiting) * ((1.0 if left else 0.0) - chance))


def markdown(found: Forecast) -> str:
    """Return the numbers of a forecast as tables in Markdown."""
    lines = ["| horizon | ADE, m | of constant velocity | FDE, m | of constant velocity |", "|---|---|---|---|---|"]
    for (horizon, *ade), (_, *fde) in zip(found.ade, found.fde, strict=True):
        lines.append(f"| {horizon:g} s | " + " | ".join(_shown(value, ".3f") for value in (*ade, *fde)) + " |")
    lines += [
        "",
        "| tube for | " + " | ".join(f"outside at {time:g} s" for time in TIMES) + " |",
        "|---|" + "---|" * len(TIMES),
    ]
    for chance in CHANCES:
        shares = (_shown(share, ".1%").replace("%", " %") for c, _, share in found.outside if c == chance)
        lines.append(f"| chance {chance:g} | " + " | ".join(shares) + " |")
    return "\n".join(lines)


def _mean(values: NDArray[np.generic]) -> float:
    """Return the mean; that of no values is NaN."""
    return float(values.mean()) if values.size else math.nan


def _shown(value: float, form: str) -> str:
    """Return a number in this format, or a dash for NaN."""
    return "-" if math.isnan(value) else format(value, form)


def _estimates(walkers: list[Floats]) -> tuple[Floats, Floats, Floats]:
    """Replay recorded tracks; return the time, the track estimate and the velocity over the last STEP for each prediction."""
    table = np.vstack([_steps(name, walker) for name, walker in enumerate(walkers)])
    table = table[np.argsort(table[:, 0], kind="stable")]
    memory, pool = make_table(4096, COLUMNS), np.zeros(POOL)
    times, rows, last = [], [], []
    for t in np.unique(table[:, 0]):
        scan = table[table[:, 0] == t]
        estimates = np.zeros((len(scan), 8))
        estimates[:, (X, Y)], estimates[:, (VX, VY)], estimates[:, ID] = scan[:, 2:4], scan[:, 4:6], scan[:, 1]
        seen, changes, out = np.ones(len(scan), np.bool_), np.zeros((len(scan), 4)), np.empty_like(estimates)  # without walls
        averaged(memory, pool, estimates, seen, changes, float(t), False, out)
        known = scan[:, 8] >= PAST - 1e-9
        times.append(np.full(int(known.sum()), t))
        rows.append(out[known])
        last.append(scan[known, 6:8])
    return np.concatenate(times), np.vstack(rows), np.vstack(last)


def _steps(name: float, walker: Floats) -> Floats:
    """Return a row for each step of a track.

    These are time, id, place, velocity over the last 0.1 s or since the row before if that is longer, velocity over the last
    STEP s, and time since the first row. In 1/30 s, as cameras have, errors of places would be most of a velocity.
    """
    t, xy = walker[:, :1], walker[:, 1:]

    def velocity(time: float) -> Floats:
        since = np.minimum(np.searchsorted(t[:, 0], t[1:, 0] - time - 1e-9), np.arange(len(t) - 1))
        over: Floats = (xy[1:] - xy[since]) / (t[1:] - t[since])
        return over

    return np.column_stack((t[1:], np.full(len(t) - 1, name), xy[1:], velocity(0.1), velocity(STEP), t[1:] - t[0]))
