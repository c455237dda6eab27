"""Uncertainty of predicted places: the variance of a track's place over time, and the radius of the tube around it."""

from __future__ import annotations

import math

from antway.kernels.base.jit import kernel
from antway.kernels.tracking.prediction_error import LATER

# Fitted to the recordings eth, zara01, students01 (Pellegrini 2009, Lerner 2007) and citr (Yang 2019), see docs/people.md.
PEOPLE_DENSITY = 0.01  # m^2/s^3; spectral density of the white acceleration of people
PEOPLE_DOF = 3.0  # 1; degrees of freedom of the distribution of people's prediction errors
_STEP = 0.02  # 1; step size with which the logarithm of the tubes' width is adapted after each prediction
_MOST = 4.0  # 1; by no more than this does it change before the predictions that wait for their outcome are judged
_OWN = 0.5  # 1; share of the squared velocity error that comes from the estimate and not from the acceleration


@kernel
def place_variance(p11: float, p12: float, p22: float, density: float, t: float) -> float:
    """Return the variance of a track's place along one axis `t` s after its estimate, m^2.

    Parameters
    ----------
    p11, p12, p22 : float
        Variances of place (m^2) and velocity (m^2/s^2), and their covariance (m^2/s).
    density : float
        Spectral density of the white acceleration that changes the velocity, m^2/s^3.

    Notes
    -----
    p11 + 2 t p12 + t^2 p22 + density t^3 / 3 (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-4).
    """
    return p11 + 2.0 * t * p12 + t * t * p22 + density * t * t * t / 3.0


@kernel
def tube_radius(variance: float, chance: float, dof: float) -> float:
    """Return the radius of the disc around a predicted place outside of which the track is with probability `chance`, m.

    Parameters
    ----------
    variance : float
        Variance along each axis, m^2.
    chance : float
        In (0, 1).
    dof : float
        Degrees of freedom of Student's t distribution in two dimensions; infinite means a normal distribution. People mostly
        keep their velocity and turn now and then, so their errors have heavier tails than a normal distribution.

    Notes
    -----
    P(r > R) = (1 + R^2 / (dof variance))^(-dof / 2), which tends to exp(-R^2 / (2 variance)).
    """
    if dof == math.inf:
        return math.sqrt(-2.0 * math.log(chance) * variance)
    return math.sqrt(dof * (chance ** (-2.0 / dof) - 1.0) * variance)


@kernel
def people_variance(sigma_v: float, t: float) -> float:
    """Return the variance of a person's place along one axis `t` s from now, m^2.

    Parameters
    ----------
    sigma_v : float
        Standard deviation along one axis of the velocity error over LATER s, m/s (kernels/tracking/prediction_error.py).
    """
    own = max(_OWN * sigma_v * sigma_v - PEOPLE_DENSITY * LATER / 3.0, 0.0)
    return place_variance(1e-4, 0.0, own, PEOPLE_DENSITY, t)


@kernel
def learnt_factor(factor: float, left: bool, chance: float, waiting: int) -> float:
    """Return the factor for the radii of tubes after one more prediction; `left` tells whether the track left its tube.

    Parameters
    ----------
    factor : float
        The factor before this prediction, > 0.
    chance : float
        Share of predictions that may leave their tubes, in (0, 1).
    waiting : int
        Number of predictions that were made since this one, > 0. They were made with factors that did not know its outcome.

    Notes
    -----
    Its logarithm rises by s (1 - chance) or falls by s chance, where s = min(0.02, 4 / `waiting`). Over N predictions, the
    share that leaves its tube then differs from `chance` by at most ln(highest / lowest factor) / (s N), however people move
    (Gibbs, Candes: Adaptive conformal inference under distribution shift, NeurIPS 2021). In a crowd that is recorded 25 times a
    second thousands of predictions wait: with 0.02 for each of them the factor swings by e^20 and more.
    """
    return factor * math.exp(min(_STEP, _MOST / waiting) * ((1.0 if left else 0.0) - chance))
