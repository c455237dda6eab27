"""Rounds: any policy drives a robot from stop to stop, in an order that is revised when the situation changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from antway import checks
from antway.errors import BadParameter
from antway.grid import Grid
from antway.world.order_planner import OrderOutlook, OrderPlanner
from antway.world.policy import XY, Command, Decision, Observation, Policy, Task, as_policy
from antway.world.standing import StandingObstacles
from antway.world.stops import Rounds, Stop, Turn, Visit, checked_stops
from antway.world.stopwatch import stopwatch

STAY = 1.0  # s; the robot should arrive at a stop when it can stand there for this time
REVIEW = 1.0  # s; period at which the order is reviewed
DETOUR = 1.0  # m; change of the path to the next stop from which the order is revised


@dataclass(slots=True)
class _Service:
    """The service of the stop at which the robot is."""

    stop: int
    arrival: float  # s
    done: float = 0.0  # s; how long the stop has been served


@runtime_checkable
class Departs(Protocol):
    """A policy that departs for another destination while the robot drives, and whose guard keeps its certified stop."""

    def depart(self, task: Task, seed: int) -> None:
        """Prepare for `task`, which has another start and goal than the one before, and may have other walls."""


class RoundsPolicy:
    """A policy that visits stops, and drives to each of them by another policy.

    The order minimises first the lateness and then the end time, with travel times at 0.85 of the top speed. It is revised at
    each departure; when the robot becomes late; when an obstacle that has stood for 3 s is on the next stop, blocks the path to
    it or makes it longer; and when a stop is added. The robot takes another order only if that avoids lateness, is 0.5 s less
    late or ends 3 s earlier. For up to 13 stops a dynamic program finds the order; for more the colony continues from its last
    answer.

    Each departure resets the policy. After the first one, a policy that `Departs` is told to depart instead.
    """

    def __init__(self, policy: Policy, stops: Sequence[Stop]) -> None:
        self.policy = as_policy(policy)
        listed = checks.sequence("stops", stops, "a sequence of stops")
        self.given = tuple(checks.instance(f"stops[{k}]", stop, Stop) for k, stop in enumerate(listed))
        self._clear()

    def _clear(self) -> None:
        """Forget the record of an earlier episode, and the stops that were added in it."""
        self.stops = list(self.given)
        self.visits: list[Visit] = []
        self.turns: list[Turn] = []
        self.order_ms: list[float] = []  # time of each decision on the order, ms
        self.homeward = False  # whether all stops have been visited and the robot is on its way to the goal

    @property
    def rounds(self) -> Rounds:
        """The record so far."""
        return Rounds(tuple(self.stops), tuple(self.visits), tuple(self.turns))

    def reset(self, task: Task, seed: int) -> None:
        """Decide on the first order, and start."""
        checks.instance("task", task, Task)
        checks.seed(seed)
        self._clear()
        self.task, self.seed = task, seed
        self.now, self.xy = 0.0, task.start  # of the last observation
        self.planner = OrderPlanner(task, self.stops, seed)
        self.standing = StandingObstacles()
        self.walls: dict[int, float] = {}  # ids of the obstacles that count as walls since the last review, and since when
        self.reviewed = 0.0  # s; time of the last review
        self.remaining = list(range(len(self.stops)))
        self.order: list[int] = []  # the remaining stops, in the order in which they will be visited
        self.promised = OrderOutlook(0.0, 0.0)  # of the order, when it was chosen
        self.service: _Service | None = None
        self.departures = 0
        # The last decision of the policy, what the robot did then, and the decision that tells both.
        self._explained: tuple[Decision, str, Decision] | None = None
        self._decide("the first order")
        self._depart()

    def add(self, stop: Stop) -> None:
        """Add a stop."""
        listed = checked_stops([*self.stops, stop], self.task)
        if not self.planner.leads_to(self.xy, stop.at):
            raise BadParameter("stop", stop.at, "where a path leads")
        self.stops[:] = listed
        self.remaining.append(len(self.stops) - 1)
        self.planner.measure()
        self.homeward, target = False, self._target
        self._decide(f"{stop.name or 'a stop'} was added")
        if self.service is None and self._target != target:
            self._depart()

    def act(self, observation: Observation) -> Command:
        """Return the command of the policy on the way to the next stop, or during service."""
        self.now, self.xy = observation.t, observation.xy
        sensed_at = observation.sensed_at
        self.standing.observe(observation.tracks, sensed_at if sensed_at > -math.inf else self.now)
        if self.service is None and self.order and self._near(self.order[0]):
            self.service = _Service(self.order[0], self.now)
        if self.service is not None:
            self._serve(self.service)
        elif self.now - self.reviewed >= REVIEW:
            self._review()
        return self.policy.act(observation)

    def explain(self) -> Decision:
        """Return the decision of the policy, with the next stop."""
        decision, doing = self.policy.explain(), self._doing()
        if self._explained is None or self._explained[0] is not decision or self._explained[1] != doing:
            action = decision.action if self.service is None else "arrived"
            self._explained = decision, doing, replace(decision, action=action, reason=f"{doing}{decision.reason}")
        return self._explained[2]

    def _doing(self) -> str:
        """Return the beginning of a reason: the stop to which the robot drives, or at which it is."""
        if self.service is None:
            return f"to {self._name(self.order[0]) if self.order else 'the end'}: "
        name, earliest = self._name(self.service.stop), self.stops[self.service.stop].window[0]
        return f"waits at {name} until {earliest:g} s; " if earliest > self.now else f"at {name}; "

    def _name(self, stop: int) -> str:
        return self.stops[stop].name or "the next stop"

    def _near(self, stop: int, tolerances: float = 1.0) -> bool:
        return math.dist(self.xy, self.stops[stop].at) <= tolerances * self.task.goal_tolerance

    @property
    def _target(self) -> XY:
        """The next stop, or the goal."""
        return self.stops[self.order[0]].at if self.order else self.task.goal

    def _serve(self, service: _Service) -> None:
        """Wait for the window and serve while the robot is at the stop; then depart for the next one."""
        stop = self.stops[service.stop]
        start = max(service.arrival, stop.window[0])
        if self.now > start and self._near(service.stop, 2.0):  # after a step aside, service continues
            service.done += min(self.task.robot.dt, self.now - start)
        if self.now < start or service.done < stop.service - 1e-9:
            return
        self.visits.append(Visit(service.stop, service.arrival, start, self.now))
        self.remaining.remove(service.stop)
        self.order.remove(service.stop)
        self.service = None
        self._decide(f"{stop.name or 'a stop'} is done")
        self._depart()

    def _depart(self) -> None:
        """Let the policy drive to the next stop, or to the goal."""
        self.homeward, self._explained = not self.remaining, None
        stay = STAY if self.order else 0.0
        task = replace(self.task, grid=self._map_of_leg(), start=self.xy, goal=self._target, stay=stay)
        start = self.policy.depart if self.departures and isinstance(self.policy, Departs) else self.policy.reset
        start(task, (self.seed + self.departures) % 2**64)
        self.departures += 1

    def _map_of_leg(self) -> Grid:
        """Return the map with the cells that are completely inside standing obstacles blocked.

        Obstacles at the robot's place or destination are left out, because no policy plans to a place inside a wall, and they
        may move on.
        """
        grid, ends, apart = self.task.grid, (self.xy, self._target), set()
        for number in self.walls.keys() & self.standing.sightings.keys():
            one = self.standing.sightings[number]
            if min(math.dist((one.x, one.y), end) for end in ends) >= one.radius + self.task.robot.radius + grid.resolution:
                apart.add(number)
        return self.standing.block(grid, apart, -0.71 * grid.resolution)  # half the diagonal of a cell

    def _review(self) -> None:
        """Revise the order if the path to the next stop has changed, or if the robot is late."""
        self.reviewed = self.now
        reason = self._change_of_path()
        changed = bool(reason)
        if not changed and self.order:
            outlook = self.planner.outlook(self.xy, self.now, self.order)
            if outlook.clearly_worse_than(self.promised):
                late, delay = outlook.lateness - self.promised.lateness, outlook.end - self.promised.end
                reason = f"{max(late, delay):.0f} s late"
                self.promised = outlook
        if reason:
            target = self._target
            self._decide(reason)
            if changed or self._target != target:
                self._depart()

    def _change_of_path(self) -> str:
        """Put the obstacles that count as walls on the map; return why the path to the next stop has changed, if it has."""
        walls = self.standing.walls()
        if walls == self.walls:
            return ""
        new, before = walls.items() - self.walls.items(), self.planner.path_length(self.xy, self._target)
        self.walls = walls
        self.planner.present = self.standing.block(self.planner.inflated, walls.keys(), self.task.robot.radius)
        longer = self.planner.path_length(self.xy, self._target) - before
        if abs(longer) <= DETOUR:
            return ""
        if longer < 0.0:
            return "the path is free again"
        # Where nobody has come to a stand, somebody who stands already is larger than was seen before.
        return f"obstacle {min(new)[0]} stands in the way" if new else "the path has become longer"

    def _decide(self, reason: str) -> None:
        """Search for the best order of the remaining stops, and take it if it is clearly better."""
        taken = stopwatch()
        if self.remaining:
            order, self.promised = self.planner.improve(self.xy, self.now, self.remaining, self.order)
            if order != self.order or not self.turns:
                self.turns.append(Turn(self.now, tuple(order), reason))
            self.order = order
        self.order_ms.append(taken())
