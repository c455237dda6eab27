"""How a policy shows its ants at work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from antway.world.policy import Decision


class LaidTrails(NamedTuple):
    """Pheromone on moves between places."""

    here: NDArray[np.float64]  # [N, 2] x and y, m
    there: NDArray[np.float64]  # [N, 2]
    amount: NDArray[np.float64]  # [N]


@dataclass(frozen=True, slots=True, eq=False)
class AntStep:
    """The work of a policy's ants in one control cycle."""

    idle: str  # why no ants took part; empty if they did
    done: bool  # whether the ants finished by themselves, so that more ant cycles would not change the decision
    decision: Decision


@runtime_checkable
class ShowsAnts(Protocol):
    """A policy whose ants can be watched at work."""

    def use_common_memory(self) -> None:
        """From now on search in memory that all policies of a thread share; each search starts with empty memory."""

    def step_ants(self, cycles: int, act: Callable[[], object]) -> AntStep:
        """Return the result of the control cycle that `act` plays, with at most `cycles` ant cycles."""

    def trails(self) -> LaidTrails:
        """Return the pheromone to show."""
