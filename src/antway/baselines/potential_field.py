"""Policy `potential-field`: attraction by the target, repulsion by walls and moving obstacles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.baselines.replan import STOP, Avoider, short_of_walls
from antway.kernels.baselines.potential_field import disc_force, wall_force
from antway.world.nearby import now
from antway.world.policy import XY, Command, Observation, Task


@dataclass(kw_only=True, eq=False, repr=False)
class PotentialField(Avoider):
    """Descend a potential: the target attracts, walls and moving obstacles repel; the force is the commanded velocity.

    The attraction grows with the distance up to full speed at `conic` m. A wall at distance d < `influence` repels with `wall`
    (1/d - 1/influence) / d^2, times the squared distance to the goal, limited to `conic` m, so that a goal near a wall can be
    reached (Ge and Cui 2000). A moving obstacle repels by distance and speed of approach (Ge and Cui 2002, see
    kernels/baselines/potential_field.py). Steps end before walls, where the potential is infinite.

    Known faults: dead ends (without `look_ahead`), oscillation in narrow passages, and places where forces cancel.

    Parameters
    ----------
    look_ahead : float or None
        The target is the farthest visible point of the global path up to this distance, m, > 0; None: the goal itself.
    conic : float
        m, > 0.
    wall, influence : float
        Gain of the walls, m^4/s, >= 0, and the distance from which they act, m, > 0.
    moving, far : float
        Gain of moving obstacles, m^3/s, >= 0, and the distance beyond the braking distance from which they act, m, > 0.
    brake : float
        Upper limit of the deceleration used for the braking distance, m/s^2, > 0.

    Notes
    -----
    Khatib: Real-time obstacle avoidance for manipulators and mobile robots, IJRR 5(1), 1986. Ge, Cui: New potential functions
    for mobile robot path planning, IEEE Trans. Robotics and Automation 16(5), 2000. Ge, Cui: Dynamic motion planning for mobile
    robots using potential field method, Autonomous Robots 13, 2002.
    """

    look_ahead: float | None = 2.0
    conic: float = 0.5
    wall: float = 0.002
    influence: float = 0.4
    moving: float = 0.05
    far: float = 1.5
    brake: float = 2.0

    def __post_init__(self) -> None:
        if self.look_ahead is not None:
            checks.fields(self, "look_ahead", low=0.0, open_low=True, unit="m")
        checks.fields(self, "conic", "influence", "far", low=0.0, high=1e6, open_low=True, unit="m")
        checks.fields(self, "wall", low=0.0, high=1e9, unit="m^4/s")
        checks.fields(self, "moving", low=0.0, high=1e9, unit="m^3/s")
        checks.fields(self, "brake", low=0.0, open_low=True, unit="m/s^2")

    def reset(self, task: Task, seed: int) -> None:
        """Label the walls: blocked cells that touch, even at corners, are one wall."""
        from scipy.ndimage import label

        super().reset(task, seed)
        walls, count = label(task.grid.blocked, np.ones((3, 3)))
        self.walls: NDArray[np.int32] = walls.astype(np.int32)
        self.near = np.empty((count + 5, 3))
        self.kept = self.conic  # within this distance of the goal its attraction is weak
        self.frame = np.array([task.grid.origin[0], task.grid.origin[1], task.grid.resolution])

    def steer(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        o = observation
        target = self.task.goal if self.look_ahead is None else self.target(o, self.look_ahead)
        if target is None:
            return STOP
        fx, fy, obstacle = self._force(o, target)
        if obstacle < 0:
            self.decide("follow", "no moving obstacle repels", local_target=target)
        else:
            self.decide("avoid", "moving obstacles repel", obstacle=int(o.tracks.id[obstacle]), local_target=target)
        return short_of_walls(self.task, o, fx, fy)

    def _force(self, o: Observation, target: XY) -> tuple[float, float, int]:
        """Return the force, which is the velocity in m/s, and the track that repels most, or -1."""
        robot, (x, y), (vx, vy) = self.task.robot, o.xy, o.velocity
        dx, dy = target[0] - x, target[1] - y
        away = math.hypot(dx, dy)
        pull = robot.v_max / max(away, self.conic)
        wx, wy, u = wall_force(self.walls, self.frame, x, y, robot.radius, self.influence, self.near)
        gx, gy = self.task.goal[0] - x, self.task.goal[1] - y
        rho = math.hypot(gx, gy)
        held = min(rho / self.conic, 1.0)
        # -grad of eta/2 (1/d - 1/influence)^2 rho^2: the second part pulls to the goal, and is 0 where rho is constant.
        back = u / self.conic**2 if rho < self.conic else 0.0
        xy, velocity = now(o)
        brake = min(self.brake, robot.braking)
        mx, my, obstacle = disc_force(x, y, vx, vy, robot.radius, brake, self.far, xy, velocity, o.tracks.radius)
        fx = pull * dx + self.wall * (held**2 * wx + back * gx) + self.moving * mx
        fy = pull * dy + self.wall * (held**2 * wy + back * gy) + self.moving * my
        return fx, fy, obstacle
