"""What a policy shows of its ants at work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from antway.world.policy import Decision


class LaidTrails(NamedTuple):
    """Pheromone on moves between cells."""

    here: NDArray[np.int64]  # [N, 2] (row, col)
    there: NDArray[np.int64]  # [N, 2]
    amount: NDArray[np.float64]  # [N]


@dataclass(frozen=True, slots=True, eq=False)
class AntStep:
    """What the ants of a policy did in one control cycle.

    Attributes
    ----------
    idle : str
        Why no ants took part; empty if some did.
    done : bool
        Whether they ended by themselves: with more cycles of theirs the control cycle comes to the same.
    decision : Decision
    """

    idle: str
    done: bool
    decision: Decision


@runtime_checkable
class ShowsAnts(Protocol):
    """A policy whose ants can be watched at work."""

    def use_common_memory(self) -> None:
        """Search in memory that all policies in one thread share, from now on: each search begins with an empty one."""

    def step_ants(self, cycles: int, act: Callable[[], object]) -> AntStep:
        """Tell what comes of the control cycle that `act` plays, if the ants do at most so many cycles of their own."""

    def trails(self) -> LaidTrails:
        """Return the pheromone that is worth showing."""
