"""How far from its predicted place a track may be: the variance of the place as time goes on, and the tube that holds it."""

from __future__ import annotations

import math

from antway.kernels.base.jit import kernel

# Fitted to the recordings eth, zara01, students01 (Pellegrini 2009, Lerner 2007) and citr (Yang 2019), see docs/people.md.
PEOPLE_DENSITY = 0.01  # m^2/s^3; of white acceleration
PEOPLE_DOF = 3.0  # degrees of freedom of the law of their errors
_STEP = 0.02  # by which the logarithm of the tubes' width changes with each prediction
_OWN, _OVER = 0.5, 0.8  # part of the squared error of velocities that is theirs alone; s over which those are observed


@kernel
def place_variance(p11: float, p12: float, p22: float, density: float, t: float) -> float:
    """Variance in m^2, along one axis, of where a track is `t` s after its estimate.

    Parameters
    ----------
    p11, p12, p22 : float
        Variances of place (m^2) and velocity (m^2/s^2), and their covariance (m^2/s).
    density : float
        Of white acceleration, m^2/s^3: what changes the velocity from now on.

    Notes
    -----
    p11 + 2 t p12 + t^2 p22 + density t^3 / 3 (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-4).
    """
    return p11 + 2.0 * t * p12 + t * t * p22 + density * t * t * t / 3.0


@kernel
def tube_radius(variance: float, chance: float, dof: float) -> float:
    """Radius in m of the disc round a predicted place that the track is outside of with probability `chance`.

    Parameters
    ----------
    variance : float
        Along one axis, m^2; the same along the other.
    chance : float
        In (0, 1).
    dof : float
        Degrees of freedom of Student's t in two dimensions; infinite: normal. People mostly go on, and now and then do not,
        which has heavier tails than the normal.

    Notes
    -----
    P(r > R) = (1 + R^2 / (dof variance))^(-dof / 2), which tends to exp(-R^2 / (2 variance)).
    """
    if dof == math.inf:
        return math.sqrt(-2.0 * math.log(chance) * variance)
    return math.sqrt(dof * (chance ** (-2.0 / dof) - 1.0) * variance)


@kernel
def people_variance(sigma_v: float, t: float) -> float:
    """Variance in m^2, along one axis, of where a person is `t` s from now.

    Parameters
    ----------
    sigma_v : float
        Standard deviation along one axis of how wrong velocities have been over 0.8 s, m/s (kernels/tracking/averages.py).
    """
    own = max(_OWN * sigma_v * sigma_v - PEOPLE_DENSITY * _OVER / 3.0, 0.0)
    return place_variance(1e-4, 0.0, own, PEOPLE_DENSITY, t)


@kernel
def learnt_factor(factor: float, left: bool, chance: float) -> float:
    """Factor for the radii of tubes after one more prediction, which `left` its tube or not.

    Parameters
    ----------
    factor : float
        Before it, > 0.
    chance : float
        Share that is to leave, in (0, 1).

    Notes
    -----
    Its logarithm goes up by 0.02 (1 - chance) or down by 0.02 chance, so that over N predictions the share that leaves differs
    from `chance` by no more than ln(highest / lowest factor) / (0.02 N), whatever people do (Gibbs, Candes: Adaptive conformal
    inference under distribution shift, NeurIPS 2021).
    """
    return factor * math.exp(_STEP * ((1.0 if left else 0.0) - chance))
