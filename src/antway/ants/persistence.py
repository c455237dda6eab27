"""How much pheromone remains after a cycle: tau <- rho tau + dtau with the persistence rho, Eq. (2); 1 - rho evaporates.

A persistence is a frozen dataclass; `numbers()` returns it as float64[4] for `kernels.colony.pheromone`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter
from antway.kernels.colony import pheromone as kernel


class Persistence(Protocol):
    """A persistence, as numbers for the kernels."""

    def numbers(self) -> NDArray[np.float64]:
        """Return (kind, a, b, c), float64[4]."""
        ...


@dataclass(frozen=True, slots=True)
class Constant:
    """rho_ij = rho, in [0, 1].

    Examples
    --------
    >>> Constant(1.5)
    Traceback (most recent call last):
    antway.errors.BadParameter: rho = 1.5: must be a finite number in [0, 1]
    """

    rho: float = 0.5

    def __post_init__(self) -> None:
        checks.fields(self, "rho", low=0.0, high=1.0)

    def numbers(self) -> NDArray[np.float64]:
        return np.array([kernel.CONSTANT, self.rho, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Adaptive:
    """The paper's III.D with its lost minus sign restored: rho_ij = clip(exp(-tau_min / tau_ij) + exp(-t), lo, hi).

    tau_min is the least pheromone on any edge, t the number of cycles done. Pheromone persists more on strong edges.
    """

    lo: float = 0.1
    hi: float = 0.9

    def __post_init__(self) -> None:
        _span(self)

    def numbers(self) -> NDArray[np.float64]:
        return np.array([kernel.ADAPTIVE, self.lo, self.hi, 0.0])


@dataclass(frozen=True, slots=True)
class Printed:
    """The paper's III.D as printed: rho_ij = exp(tau_min / tau_ij) + exp(-t). It is here to show that it diverges.

    Always rho_ij > 1, so every edge gains pheromone without any ant, and the weakest edge gains fastest. Differences vanish,
    and after about 700 cycles the numbers overflow. Rules with limits clip the pheromone in each cycle.
    """

    def numbers(self) -> NDArray[np.float64]:
        return np.array([kernel.PRINTED, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Decay:
    """rho_t = max(lo, first * factor**t) in cycle t: the colony forgets slowly at first and faster later."""

    first: float = 0.95
    factor: float = 0.99
    lo: float = 0.5

    def __post_init__(self) -> None:
        checks.fields(self, "first", "factor", "lo", low=0.0, high=1.0)

    def numbers(self) -> NDArray[np.float64]:
        return np.array([kernel.DECAY, self.first, self.factor, self.lo])


@dataclass(frozen=True, slots=True)
class ByQuality:
    """rho_t = lo + (hi - lo) exp(-(L_cycle / L_best - 1) / spread): the worse the best of a cycle, the more evaporates.

    L_cycle is the length of the cycle's best solution, L_best that of the best so far; spread > 0 is a relative length.
    """

    lo: float = 0.5
    hi: float = 0.95
    spread: float = 0.05

    def __post_init__(self) -> None:
        _span(self)
        checks.fields(self, "spread", low=0.0, open_low=True)

    def numbers(self) -> NDArray[np.float64]:
        return np.array([kernel.BY_QUALITY, self.lo, self.hi, self.spread])


def _span(policy: Adaptive | ByQuality) -> None:
    """Check 0 <= lo <= hi <= 1."""
    checks.fields(policy, "lo", "hi", low=0.0, high=1.0)
    if policy.lo > policy.hi:
        raise BadParameter("lo", policy.lo, f"at most hi = {policy.hi}")
