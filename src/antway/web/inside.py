"""A look inside one control cycle: what its ants have found after a number of their own cycles, and their pheromone."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway.world.ants import ShowsAnts
from antway.world.episode import Episode
from antway.world.policy import Decision, Policy


@dataclass(frozen=True, slots=True)
class Look:
    """The next control cycle, with at most `cycles` ant cycles.

    Attributes
    ----------
    cycles : int
    done : bool
        Whether the ants finished by themselves, so that the control cycle will have the same result.
    decision : Decision
    policy : Policy
        A copy of the policy after this.
    """

    cycles: int
    done: bool
    decision: Decision
    policy: Policy


def look_inside(episode: Episode, policy: Policy, cycles: int) -> Look | str:
    """Play the next control cycle on a copy with at most `cycles` ant cycles; return why if no ants take part in it."""
    if not isinstance(policy, ShowsAnts):
        return "This policy has no ants."
    shared = (episode.scenario, episode.stage.task, episode.stage.timeline)  # constant, so it need not be copied
    trial, ants = copy.deepcopy((episode, policy), {id(thing): thing for thing in shared})
    step = ants.step_ants(cycles, trial.step)
    return step.idle or Look(cycles, step.done, step.decision, ants)


def edges(policy: Policy, most: int) -> NDArray[np.float64]:
    """Return the strongest trails of a policy's ants, float64[n, 5]: both ends (x, y, x, y) in m, and relative strength."""
    if not isinstance(policy, ShowsAnts):
        return np.empty((0, 5))
    here, there, amount = policy.trails()
    if not len(amount):
        return np.empty((0, 5))
    best = np.argsort(-amount, kind="stable")[:most]
    best = best[amount[best] > 0.05 * amount[best[0]]]
    return np.column_stack((here[best], there[best], amount[best] / amount[best[0]]))
