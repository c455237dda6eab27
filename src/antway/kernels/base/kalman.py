"""The scalar arithmetic of a Kalman filter for constant velocity, the same for every axis."""

from __future__ import annotations

from antway.kernels.base.jit import bare_kernel


@bare_kernel
def measure_place(
    p11: float, p12: float, p22: float, dt: float, agility: float, variance: float
) -> tuple[float, float, float, float, float]:
    """Predict a covariance `dt` s ahead and update it by a measured place; return the gains and the new covariance.

    The covariance is p11, the variance of the place (m^2), p12, the covariance with the velocity (m^2/s), and p22, the variance
    of the velocity (m^2/s^2). `agility` is the standard deviation of the mean of the white acceleration over `dt`, m/s^2;
    `variance`, m^2, is that of the measured place. The gains g1 and g2 say by how much of the innovation (measured less
    predicted place) the place and the velocity (1/s) change.

    Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation, 2001, ch. 6.2.2, where the
    acceleration is continuous white noise. With an acceleration that is constant between measurements (their ch. 6.3.2) and
    exact places, a wrong velocity would oscillate for ever: it becomes twice the mean velocity minus itself at each update.
    """
    q = agility * agility
    p11 = p11 + 2 * dt * p12 + dt * dt * p22 + q * dt**4 / 3
    p12 = p12 + dt * p22 + q * dt**3 / 2
    p22 = p22 + q * dt * dt
    s = p11 + variance
    g1, g2 = (p11 / s, p12 / s) if s > 0.0 else (1.0, 0.0)
    return g1, g2, (1 - g1) * p11, (1 - g1) * p12, p22 - g2 * p12
