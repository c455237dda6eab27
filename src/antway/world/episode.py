"""An episode: sense, decide and drive, with exact contact tests, until the goal, a contact or the horizon."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, described_error
from antway.kernels.base.geometry import TOUCH
from antway.kernels.robot.motion import REST
from antway.lazy import Later, drawing
from antway.limits import MAX_TIME
from antway.planning import TimedPath
from antway.version import __version__
from antway.world.order_planner import check_reachable
from antway.world.policy import Command, Decision, Foresees, Observation, Plans, Policy, as_policy, make_policy
from antway.world.rounds import RoundsPolicy
from antway.world.scenario import Scenario
from antway.world.stage import Stage
from antway.world.stops import Rounds
from antway.world.stopwatch import stopwatch
from antway.world.trace import Outcome as Outcome
from antway.world.trace import Trace

_FAULTS = Exception, SystemExit  # of a policy: they end its episode, not the program


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeResult:
    """The result of an episode.

    Attributes
    ----------
    outcome : Outcome
    reason : str
        One sentence about the outcome.
    time : float
        End time, s.
    length : float
        Length driven, m.
    min_clearance : float
        Smallest distance between the edges of the robot and a moving obstacle, m; infinite without obstacles.
    replans : int
        How often the policy changed its planned motion (`Decision.path`).
    waits : int
        How often the robot came to rest; standing in the first control cycle counts, too.
    cycle_ms : float64[N]
        Wall time of each control cycle of the policy, ms, without the time spent compiling kernels.
    seed : int
    config : mapping
        How the episode was set up.
    trace : Trace or None
        The record, if it was requested.
    rounds : Rounds or None
        The stops, if the scenario has any, and how they were visited.
    order_ms : float64[M]
        Wall time of each decision on the order of the stops, ms.

    Examples
    --------
    >>> from antway import load_scenario, run
    >>> result = run(load_scenario("paper"), "follow", horizon=1.0)
    >>> result.reached, result.reason
    (False, 'the horizon of 1 s came first')
    """

    outcome: Outcome
    reason: str
    time: float
    length: float
    min_clearance: float
    replans: int
    waits: int
    cycle_ms: NDArray[np.float64]
    seed: int
    config: Mapping[str, Any] = field(default_factory=dict)
    trace: Trace | None = None
    rounds: Rounds | None = None
    order_ms: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __repr__(self) -> str:
        near = f", nearest {self.min_clearance:z.2f} m" if math.isfinite(self.min_clearance) else ""
        return f"EpisodeResult({self.outcome.value} after {self.time:.1f} s, {self.length:.2f} m driven{near})"

    def _repr_html_(self) -> str:
        return str(drawing().html(self))

    @property
    def reached(self) -> bool:
        """Whether the robot reached its goal."""
        return self.outcome is Outcome.REACHED

    def cycle(self, percent: float) -> float:
        """Return that percentile of the policy's cycle times, ms; NaN without cycles."""
        return float(np.percentile(self.cycle_ms, percent)) if len(self.cycle_ms) else math.nan


def run(
    scenario: Scenario,
    policy: str | Policy = "antway",
    *,
    seed: int | None = None,
    horizon: float | None = None,
    record: bool = True,
) -> EpisodeResult:
    """Play one episode.

    Parameters
    ----------
    scenario : Scenario
    policy : str or Policy
        A name for `make_policy`, or an object with `reset`, `act` and `explain`; `antway.policies.guard.Guarded` adds a guard
        to any. A policy with `foresee` (`antway.world.policy.Foresees`) learns where every obstacle will be. A policy with
        `planned` (`antway.world.policy.Plans`) is not asked for explanations that are not recorded.
    seed : int or None
        Seed of all randomness: obstacles, sensor, policy; None: that of the scenario.
    horizon : float or None
        Latest end of the episode, s, as in `Scenario`; None: that of the scenario.
    record : bool
        Whether the result has a trace.

    Returns
    -------
    EpisodeResult
        If the policy raises an exception, the robot brakes and the episode ends with `Outcome.ERROR`. A command that is None or
        not finite means stop.

    Raises
    ------
    BadInput
        For wrong arguments, or an obstacle that touches the robot at the start.

    Examples
    --------
    >>> from antway import Grid, RobotSpec, Scenario, World
    >>> room = Scenario(World(Grid(np.zeros((10, 10), dtype=bool))), start=(1.0, 5.0), goal=(9.0, 5.0), robot=RobotSpec())
    >>> class Straight:
    ...     def reset(self, task, seed): self.task = task
    ...     def act(self, observation): return Command((1.0, 0.0))
    ...     def explain(self): return Decision("follow", "the path is free")
    >>> result = run(room, Straight())
    >>> result.outcome, round(result.time, 6)
    (<Outcome.REACHED: 'reached'>, 7.8)
    """
    episode = Episode(scenario, policy, seed=seed, horizon=horizon, record=record)
    while episode.outcome is None:
        episode.step()
    return episode.result()


class Episode:
    """An episode played one control cycle at a time; arguments and errors are those of `run`.

    While it continues, `outcome` is None; `reason` is one sentence about it. The record is in `stage`, whose arrays are as in
    `Trace` and filled up to row `steps`, and in `decisions`, also as in `Trace`; these are empty without a record if the policy
    need not explain. `seen` is what the policy was shown last.

    Examples
    --------
    >>> from antway import load_scenario
    >>> from antway.scenes import scene
    >>> episode = Episode(load_scenario(scene("paper")), "follow", seed=1)
    >>> episode.step()
    >>> episode.steps, episode.outcome
    (1, None)
    """

    def __init__(
        self,
        scenario: Scenario,
        policy: str | Policy = "antway",
        *,
        seed: int | None = None,
        horizon: float | None = None,
        record: bool = True,
    ) -> None:
        self.scenario, self.record = checks.instance("scenario", scenario, Scenario), checks.instance("record", record, bool)
        self.seed = scenario.seed if seed is None else checks.seed(seed)
        if horizon is None:
            horizon = scenario.horizon
        horizon = checks.number("horizon", horizon, low=0.0, high=MAX_TIME, open_low=True, unit="s")
        self.stage = stage = Stage(scenario, self.seed, horizon)
        self.name, driver = (policy, make_policy(policy)) if isinstance(policy, str) else (type(policy).__name__, policy)
        self.policy: Policy = as_policy(driver)
        self.tour: RoundsPolicy | None = None
        if scenario.stops:
            check_reachable(stage.task, scenario.stops)
            self.policy = self.tour = RoundsPolicy(driver, scenario.stops)
            stage.end_at_goal(False)
        self._plans = driver if not record and isinstance(driver, Plans) else None
        self.decisions: list[tuple[int, Decision]] = []
        self.plans: list[TimedPath] = []  # the successive planned motions
        self.outcome: Outcome | None = None
        self.seen: Observation | None = None
        self.reason = self._fault = ""
        if self.tour is None and math.dist(stage.task.start, stage.task.goal) <= stage.task.goal_tolerance + TOUCH:
            self.outcome, self.reason = Outcome.REACHED, "the start is at the goal"
        try:
            if isinstance(driver, Foresees):
                driver.foresee(stage.timeline)
            self.policy.reset(stage.task, self.seed)
        except _FAULTS as error:
            self.outcome, self.reason = Outcome.ERROR, f"{self.name} at reset: {described_error(error)}"

    @property
    def steps(self) -> int:
        """Number of control cycles played."""
        return self.stage.n

    def step(self) -> None:
        """Play one control cycle: sense, decide, drive.

        Raises
        ------
        BadParameter
            If the episode has ended.
        """
        if self.outcome is not None:
            raise BadParameter("episode", self.outcome.value, "one that has not ended, for another step")
        stage, observation = self.stage, self.stage.observe()
        controls = math.nan, math.nan  # the robot brakes
        if not self._fault:
            try:
                controls = stage.controls(self._commanded(observation), observation)
                path = self._planned()
                if path is not None and not (self.plans and path is self.plans[-1]):
                    self.plans.append(path)
            except _FAULTS as error:
                self._fault = f"{self.name} at {observation.t:g} s: {described_error(error)}"
        if self.tour is not None:
            stage.end_at_goal(self.tour.homeward)
        self.outcome, self.reason = stage.drive(*controls)
        if self.outcome is Outcome.TIMEOUT:
            self.reason += self._hindered()
        if self._fault and (self.outcome is Outcome.TIMEOUT or (self.outcome is None and stage.at_rest)):
            self.outcome, self.reason = Outcome.ERROR, self._fault

    def _hindered(self) -> str:
        """Return what else is to be said of an episode that ends by its horizon."""
        if not np.isfinite(self.stage.command[: self.stage.n]).all(axis=1).any():
            return f"; {self.name} gave no command of finite numbers"
        if self.decisions and self.decisions[-1][1].action == "stuck":
            return f"; {self.decisions[-1][1].reason}"
        return ""

    def _commanded(self, observation: Observation) -> Command | None:
        """Return the command of the policy, and record its time, which does not include explanations."""
        self.seen, taken = observation, stopwatch()
        try:
            command = self.policy.act(observation)
        finally:
            self.stage.cycle_ms[self.stage.n] = taken()
        return checked_command(command)

    def _planned(self) -> TimedPath | None:
        """Return the planned motion, and record the explanation, if one is needed."""
        if self._plans is not None:
            return self._plans.planned()
        decision = self.policy.explain()
        if not self.decisions or decision is not self.decisions[-1][1]:
            self.decisions.append((self.stage.n, _checked(decision)))
        return decision.path

    def result(self) -> EpisodeResult:
        """Return the result of an episode that has ended.

        Raises
        ------
        BadParameter
            If it continues.
        """
        stage, outcome, n = self.stage, self.outcome, self.stage.n
        if outcome is None:
            raise BadParameter("episode", f"at {stage.t[n]:g} s", "one that has ended, to have a result")
        config = {"version": __version__, "horizon": stage.horizon, "sensor": asdict(self.scenario.sensor)}
        rounds = None if self.tour is None else self.tour.rounds
        trace = None
        if self.record:
            decisions = tuple(self.decisions)
            trace = stage.trace(self.name, outcome, self.reason, decisions=decisions, config=config, rounds=rounds)
        speeds = np.hypot(*stage.velocity[1 : n + 1].T)
        resting = np.concatenate(([False], speeds <= REST))
        return EpisodeResult(
            outcome=outcome,
            reason=self.reason,
            time=float(stage.t[n]),
            length=math.fsum(np.hypot(*np.diff(stage.xy[: n + 1], axis=0).T).tolist()),
            min_clearance=stage.clearance,
            replans=max(len(self.plans) - 1, 0),
            waits=int((resting[1:] & ~resting[:-1]).sum()),
            cycle_ms=stage.cycle_ms[:n].copy(),
            seed=self.seed,
            config=config,
            trace=trace,
            rounds=rounds,
            order_ms=np.array([] if self.tour is None else self.tour.order_ms),
        )


def checked_command(command: object) -> Command | None:
    """Return a policy's command, if it is one or None. None, and numbers that are not finite, mean that the robot brakes."""
    if command is None:
        return None
    known = checks.instance("command", command, Command)
    for name, pair in (("velocity", known.velocity), ("twist", known.twist)):
        for part in () if pair is None else checks.sequence(f"command.{name}", pair, "two numbers", size=2):
            if not isinstance(part, Real):
                raise BadParameter(f"command.{name}", pair, "two numbers")
    return known


def _checked(decision: object) -> Decision:
    """Return a policy's decision, if files and tables can hold it."""
    known = checks.instance("decision", decision, Decision)
    for name in ("action", "reason", "encounter", "guard"):
        checks.instance(f"decision.{name}", getattr(known, name), str)
    for name in ("gap", "time_to_closest", "distance_at_closest"):
        if not isinstance(getattr(known, name), Real):
            raise BadParameter(f"decision.{name}", getattr(known, name), "a number")
    if known.local_target is not None:
        checks.point("decision.local_target", known.local_target)
    if known.obstacle is not None:
        checks.integer("decision.obstacle", known.obstacle)
    if known.path is not None:
        path = checks.instance("decision.path", known.path, TimedPath)
        if not (np.isfinite(path.t).all() and np.isfinite(path.xy).all()):
            raise BadParameter("decision.path", path, "of finite numbers")
    for part in () if isinstance(known.alternatives, Later) else known.alternatives:
        name, cost = checks.sequence("decision.alternatives", part, "pairs of a name and a cost in s", size=2)
        checks.instance("decision.alternatives", name, str)
        if not isinstance(cost, (float, np.floating)):
            checks.number("decision.alternatives", cost, infinite=True, unit="s")
    shades = None
    if known.pheromone is not None:
        shades = checks.sequence("decision.pheromone", known.pheromone, "(row, col, float32[h, w])", size=3)[2]
    for name, array, kind, columns in (
        ("pheromone", shades, np.float32, None),
        ("history", known.history, np.float64, 4),
        ("predicted", known.predicted, np.float32, 7),
    ):
        table = isinstance(array, np.ndarray) and array.dtype == kind and array.ndim == 2
        if array is not None and not (table and columns in (None, array.shape[1])):
            raise BadParameter(f"decision.{name}", array, f"{np.dtype(kind)}[N, {columns or 'M'}]")
    return known
