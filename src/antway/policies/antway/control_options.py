"""The numbers by which the colony in the space of controls searches, and what its sequences cost."""

from __future__ import annotations

from dataclasses import dataclass, fields

from antway import checks

_HIGHEST = {"horizon": 100.0, "block": 100.0, "exploration": 1.0}  # values of these `ControlOptions`


@dataclass(frozen=True, slots=True)
class ControlOptions:
    """Numbers of the colony in the space of controls (ACO_R, Socha and Dorigo 2008) and of the costs of its sequences.

    All costs are in seconds. A robot whose top speed is n times lower than 0.8 m/s needs n times as long to get out of the way.
    For it `spread_time` and `late` are n times longer, `risk` is n^2 times larger, `spread` is the square root of n times
    larger, `decay` is n times smaller than given here, and `turn_risk` is 0: such a robot cannot get out of the way of what
    turns towards it, however it drives. At most, n counts as 4.

    Attributes
    ----------
    horizon : float
        s; duration of a sequence of controls. It is up to twice as long for robots that drive less than 1.5 m in this time, or
        turn by less than a quarter.
    block : float
        s; the random change of a control is the same for steps within this time.
    archive : int
        Size k of the archive of good sequences.
    rounds : int
        Number of iterations of the colony in a control cycle.
    ants : int
        Number of ants in an iteration. All of them are drawn from the archive as the iteration before has left it.
    locality : float
        1; locality q of the search. An ant picks its guide from the archive by rank, with normal weights whose standard
        deviation is q k ranks. The smaller q is, the more the best sequences are preferred.
    xi : float
        1; speed of convergence. An ant draws around its guide with a standard deviation of xi times the mean distance of the
        guide from the other sequences of the archive. With a larger xi the colony explores more and converges more slowly,
        as with a higher rate of evaporation.
    exploration : float
        1; share of the ants, 0 to 1, whose standard deviations are at least 0.35 of the robot's limits. Those of the others are
        at least 0.03 of the limits.
    progress : float
        1; cost, at each step, of each second that is still to go at the end of the step.
    off_plan : float
        s/m; for each metre beside the plan, the robot is taken to need this much longer to the goal than the plan.
    trust : float
        s; the robot is taken to be able to arrive this much earlier than the plan. Where no obstacle is near, it is at least
        the time in which the robot drives the goal's tolerance, and 0.05 s.
    unsure : float
        1; least standard deviation of an obstacle's predicted velocity, as a share of its speed, while one in twenty
        predictions or more fails, as is assumed at first. It falls with that share (kernels/tracking/prediction_error.py), and
        is smaller if the scenario declares that obstacles swerve less than people do.
    turned : float
        s; velocities count as wrong by at least as much as the turns of obstacles change them in this time.
    margin : float
        m; is added to the distance of the centres at which contact begins.
    preferred_gap : float
        m; gap to an obstacle, beyond `margin`, below which `near` is charged.
    near : float
        s/m; cost, at each step, of each metre that is missing to the preferred gap.
    risk : float
        s; cost of being so near to where an obstacle is expected that contact begins. It is charged once for each obstacle, at
        the step where it is largest. It decreases with the square of the distance, to zero at `spread`.
    spread : float
        1; distance from where contact begins, in standard deviations of the obstacle's predicted place
        (kernels/tracking/prediction_error.py).
    spread_time : float
        s; the standard deviation of a predicted place grows for this time ahead and then stays.
    late : float
        s; standard deviations are those of a time this much later, because a robot with inertia cannot respond at once.
    turn_risk : float
        s; cost of being where contact begins, for each turn that is expected of an obstacle in the time in which the robot
        could not respond to it any more. How often obstacles turn, and by how much, is learnt from all tracks of the episode
        (kernels/tracking/changes.py). The cost decreases to zero at the distance from which the robot can still get out of the
        way. It is charged like `risk`.
    wall_margin : float
        m; distance to keep from walls, a little more than the guard's (policies/guard.py), so that it seldom has to brake.
    wall_risk : float
        1; cost of each second at `wall_margin`, where the robot's place is uncertain. It decreases to zero at two standard
        deviations of the place from there. One standard deviation is added to `wall_margin` and to `margin`.
    contact : float
        s; cost of a predicted contact, and of each metre of its depth. It is charged once for each obstacle.
    decay : float
        1/s; rate at which the costs of contacts, risks and walls decrease with the time ahead.
    stop : float
        s/m; cost of each metre by which an obstacle could enter the stopping distance of the robot. Such a motion would not
        pass the guard in mode "strict"; in the other mode this cost is not used.
    follow : float
        s/m; cost of each metre that is missing, at the end of the next period, to the distance at which the robot can stop
        behind an obstacle that drives or walks ahead of it and brakes at 2.2 m/s^2, or at the declared bound on changes of
        velocity if that is less. It is charged in mode "least-harm".
    comfort : float
        s; cost of a change of the turn rate of wheels by its limit, however fast. It keeps ants that gain next to nothing by it
        from turning to and fro.
    search : str
        "ants" (ACO_R), or what it is compared with on the same rollouts and as many of them: "mppi" and "cem" (the
        cross-entropy method), which keep only a mean, or "random" (restarts around the seeds, without an archive).
    temperature : float
        s; temperature of the weights of "mppi".
    elite : int
        Number of best sequences in an iteration whose mean "cem" keeps.

    Raises
    ------
    BadParameter
        For a number below 0, or 0 where a size, a duration or a width has to be more; and above 100 s for `horizon` and
        `block`, 1 for `exploration`, 100,000 for whole numbers, 1e6 for others.
    """

    horizon: float = 3.0
    block: float = 0.5
    archive: int = 24
    rounds: int = 8
    ants: int = 60
    locality: float = 0.15
    xi: float = 0.85
    exploration: float = 0.15
    progress: float = 0.02
    off_plan: float = 0.5
    trust: float = 0.3
    unsure: float = 0.12
    turned: float = 0.25
    margin: float = 0.01
    preferred_gap: float = 0.05
    near: float = 0.2
    risk: float = 6.0
    spread: float = 2.0
    spread_time: float = 1.2
    late: float = 0.4
    turn_risk: float = 40.0
    wall_margin: float = 0.015
    wall_risk: float = 5.0
    contact: float = 600.0
    decay: float = 0.1
    stop: float = 10.0
    follow: float = 3.0
    comfort: float = 0.02
    search: str = "ants"
    temperature: float = 0.1
    elite: int = 6

    def __post_init__(self) -> None:
        checks.choice("search", self.search, ("ants", "mppi", "cem", "random"))
        for name in ("archive", "rounds", "ants", "elite"):
            checks.integer(name, getattr(self, name), low=0 if name == "rounds" else 1, high=100_000)
        for name in (one.name for one in fields(self) if one.type == "float"):
            above, high = name in ("horizon", "block", "locality", "temperature"), _HIGHEST.get(name, 1e6)
            checks.number(name, getattr(self, name), low=0.0, high=high, open_low=above)
