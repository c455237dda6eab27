"""The problem of optimal control that is solved in each control cycle, and the records it is made of."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import inner_kernel
from antway.kernels.base.records import RobotLimits, RobotState

# Entries of a goal: its place and its tolerance in m, and the speed in m/s above which a robot has not arrived.
GOAL_X, GOAL_Y, TOLERANCE, GOAL_SPEED = range(4)


class StaticField(NamedTuple):
    """The map for the centre of a robot. A frame is the x and y in m of a field's node (0, 0), and its nodes a metre."""

    wall: NDArray[np.float32]  # [h, w] m; distance from the robot's disc to walls, exact at the nodes; below 0 in contact
    wall_frame: Floats  # [3]
    time: NDArray[np.float32]  # [H, W] s; time to the goal from the centres of cells
    time_frame: Floats  # [3]
    goal: Floats  # [4] see GOAL_X and the others above
    box: Floats  # [5] m; a box around the footprint, low and high x and y in the robot's frame; the disc's radius
    discs: Floats  # [D, 3] m; discs that cover that box: x, y, and how much smaller than the robot's disc each is;
    # there are none for a robot that is a disc
    turning: NDArray[np.float32]  # [K + 1, H', W'] s; time to the goal of a car with the heading 2 pi k / K, and last that of
    # a robot that turns on the spot; empty for robots without a turning radius
    turning_frame: Floats  # [3]
    manoeuvre: NDArray[np.float32]  # [N, N] s; time that such a car loses to manoeuvres near its goal, by where that is in
    # its own frame; empty for other robots
    manoeuvre_frame: Floats  # [4] its fourth number is the car's top speed, m/s


class NearObstacle(NamedTuple):
    """An obstacle at the end of a step, a row of `Outlook.disc`; distances are those of the centres."""

    x: float  # m
    y: float
    contact: float  # m; distance at which contact begins
    preferred: float  # m; up to this distance a greater one is preferred
    speed: float  # m/s; bound on its speed
    vx: float  # m/s
    vy: float
    straight: float  # s; time until a wall changes its velocity
    risky: float  # m; distance at which the risk of contact begins
    owner: float  # its column in `Batch.harm`; of more obstacles than it has columns, the worse of two counts
    turn_distance: float  # m; distance at which the risk of turns begins
    turn_time: float  # s; within this time a turn comes too late for the robot to respond


class Outlook(NamedTuple):
    """Obstacles that the robot could come near to, at the end of each step of a rollout, and the plan in space and time."""

    near: Ints  # [S + 1] number of obstacles; last that of those that the robot could come near to afterwards
    disc: Floats  # [S + 1, N, 12] rows of `NearObstacle`; those of the last row, at the end of the last step
    beyond: Floats  # [S + 1, 3, N] x and y of each obstacle, m, and the square of the distance of the centres from
    # which on it costs nothing, m^2; one row after another, so that all obstacles of a step are compared at once
    plan: Floats  # [S, 3] x and y of the plan, m, and the time that it still takes from there, s


class CostWeights(NamedTuple):
    """What a rollout costs, in seconds."""

    progress: float  # 1; for each second to go at the end of each step
    contact: float  # s; for a predicted contact, and s/m for its depth; see `Batch.harm`
    decay: float  # 1/s; rate at which the weight of contacts, risks, stops and walls falls with the time ahead
    near: float  # s/m; at each step, for each metre that is missing to the preferred distance
    risk: float  # s; where contact begins; falls with the square to nothing where the risk begins; see `Batch.harm`
    turn_risk: float  # 1; where contact begins, for each s of `turn_time`; to nothing at `turn_distance`; see `Batch.harm`
    wall: float  # s; at each step at which the robot is nearer to a wall than `wall_margin`
    wall_margin: float  # m
    wall_risk: float  # 1; for each second at `wall_margin`; falls to nothing at `wall_range` from there
    wall_range: float  # m
    ramps: float  # 1; for each second that the robot will lose to ramps and turns; 0 while it waits, without a plan
    off_plan: float  # s/m; added to the time that the plan still takes, for each metre between the robot and the plan
    stop: float  # s/m; at each step, for the depth to which an obstacle could enter the robot's stop from there
    follow: float  # s/m; at the first step, for the depth of the robot's stop in the stop of an obstacle ahead of it
    stopping_time: float  # s; delay before a stop begins
    least_speed: float  # m/s; a robot that creeps is taken to need as long for its stop as at this speed
    stand: float  # s; gained by a robot that stands after the first period, so that it does not move for less
    turn_change: float  # s^2/rad; for each rad/s by which the turn rate changes, until it is 0 in the end; 0 without wheels
    swerve: float  # m/s^2; bound on the change of obstacles' velocities, but where walls change them


class Batch(NamedTuple):
    """Memory for rollouts that are stepped abreast (kernels/controls/abreast.py)."""

    value: Floats  # [ROWS * BATCH] X and the other rows in kernels/controls/abreast.py, one after another
    sequence: Ints  # [BATCH] which sequence each rollout is of
    # [BATCH, M] s; what each obstacle costs each sequence, at its worst step; if M is 0, the costs of all steps are added up
    harm: Floats
    path: Floats  # [P, 2] m; a path down the field of times to the goal (kernels/controls/seeds.py)


class ControlProblem(NamedTuple):
    """A problem of optimal control: where the robot starts, how it moves, and what a rollout of its controls costs."""

    start: RobotState
    limits: RobotLimits
    dt: float  # s; each control is held for one period
    field: StaticField
    outlook: Outlook
    weights: CostWeights
    batch: Batch


@inner_kernel
def near_at(outlook: Outlook, k: int, i: int) -> NearObstacle:
    """Return obstacle i near the robot at the end of step k."""
    row = outlook.disc[k, i]
    return NearObstacle(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11])


@inner_kernel
def set_near(outlook: Outlook, k: int, i: int, obstacle: NearObstacle) -> None:
    """Write obstacle i near the robot at the end of step k."""
    row = outlook.disc[k, i]
    row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11] = obstacle
