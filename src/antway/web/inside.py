"""A look inside one control cycle: what its ants have found after so many of their own cycles, and the trails they lay."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from antway.grid import Moves
from antway.kernels.crossing import LOOK
from antway.planning import TimedPath
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.paper.policy import PaperPolicy
from antway.world.episode import Episode
from antway.world.policy import Decision, Policy

EXPANSIONS = 5  # moves that the ants of policy antway test in what is shown as one cycle of theirs


@dataclass(frozen=True, slots=True)
class Look:
    """The control cycle to come, with at most `cycles` ant cycles.

    Attributes
    ----------
    cycles : int
    done : bool
        Whether the ants ended by themselves: the control cycle will come to the same.
    decision : Decision
    policy : Policy
        A copy of the policy as it is then.
    """

    cycles: int
    done: bool
    decision: Decision
    policy: Policy


def look_inside(episode: Episode, policy: Policy, cycles: int) -> Look | str:
    """Play the control cycle to come on a copy with at most so many ant cycles; say why if no ants take part in it."""
    if not isinstance(policy, (AntwayPolicy, PaperPolicy)):
        return "This policy has no ants."
    shared = (episode.scenario, episode.stage.task, episode.stage.timeline)  # what never changes
    trial, ants = copy.deepcopy((episode, policy), {id(thing): thing for thing in shared})
    if isinstance(ants, PaperPolicy):
        before, most = ants.colonies, ants.cycles
        ants.cycles = min(cycles, most)
        trial.step()
        if ants.colonies == before:
            return "No ants in this control cycle: policy paper sends them only for a way round what is ahead."
        done = cycles >= most or (ants.found is not None and len(ants.found.history) < cycles)
    else:
        assert isinstance(ants, AntwayPolicy)
        expansions, second = ants.settings.expansions, ants.settings.improvement_expansions
        budget = EXPANSIONS * cycles
        ants.settings = ants.settings._replace(expansions=min(expansions, budget), improvement_expansions=min(second, budget))
        due = ants.plan.state[LOOK]
        trial.step()
        tested = int(ants.memory.counter[2])
        if tested == 0:
            if ants.plan.state[LOOK] == due:
                return f"No ants in this control cycle: all goes as foreseen. They look for a better plan from {due:.2f} s on."
            return "No ants in this control cycle: no other plan can be better."
        done = tested < budget or budget >= expansions
    decision = ants.explain()
    if isinstance(ants, PaperPolicy) and ants.found is not None:  # whether or not its way was taken
        found, room = ants.found, ants.routes.inflated
        here = np.array([episode.stage.xy[episode.steps]])
        path = TimedPath(np.arange(len(found.plan.cells) + 1.0), np.vstack((here, found.plan.xy(room))))
        decision = replace(decision, path=path, pheromone=(*found.window[:2], found.pheromone_by_cell), history=found.history)
    return Look(cycles, done, decision, ants)


def edges(policy: Policy, most: int) -> NDArray[np.float64]:
    """Return the strongest trails of a policy's ants, float64[n, 5]: both ends (x, y, x, y) in m and the share of the most."""
    laid = _timed(policy) if isinstance(policy, AntwayPolicy) else _printed(policy) if isinstance(policy, PaperPolicy) else None
    if laid is None or not len(laid[2]):
        return np.empty((0, 5))
    here, there, amount = laid
    best = np.argsort(-amount, kind="stable")[:most]
    best = best[amount[best] > 0.05 * amount[best[0]]]
    grid = policy.task.grid if isinstance(policy, AntwayPolicy) else policy.routes.task.grid  # type: ignore[attr-defined]
    return np.column_stack((grid.to_xy(here[best]), grid.to_xy(there[best]), amount[best] / amount[best[0]]))


Laid = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]  # cells, next cells (row, col), amounts


def _timed(policy: AntwayPolicy) -> Laid:
    """The trails of policy antway: on moves between cells, by the time of arrival; the most over all times."""
    trails, (rows, cols) = policy.trails, policy.task.grid.shape
    used = np.flatnonzero(trails.key >= 0)
    cell, move = trails.key[used] // 64 % (rows * cols), trails.key[used] % 64
    key, at = np.unique(cell * 64 + move, return_inverse=True)
    amount = np.zeros(len(key))
    np.maximum.at(amount, at, trails.tau[used])
    here = np.column_stack(np.divmod(key // 64, cols))
    return here, here + policy.moves.offsets.astype(np.int64)[key % 64], amount


def _printed(policy: PaperPolicy) -> Laid | None:
    """The trails of policy paper: what its last colony laid on the moves between cells beyond the least on any."""
    found = policy.found
    if found is None:
        return None
    tau = found.pheromone
    least = tau.min(initial=np.inf, where=tau > 0.0)
    row, col, move = np.nonzero(tau > 1.01 * least)
    here = np.column_stack((row + found.window[0], col + found.window[1]))
    return here, here + Moves.EIGHT.offsets.astype(np.int64)[move], tau[row, col, move]
