"""What the node shows of its plans in RViz and Foxglove: decision, planned motion, pheromone, predictions; no ROS import."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from antway.grid import Grid
from antway.policies.paper.tubes import Tubes
from antway.ros2 import convert
from antway.ros2.convert import Make, plain
from antway.ros2.frames import Pose, chain
from antway.ros2.messages import make
from antway.world.policy import XY, Decision, Tracks

if TYPE_CHECKING:
    from antway.ros2.pilot import Pilot

SEEN_AHEAD = 3.0  # s; how far ahead predictions are shown
_COLOURS = {"follow": (0.1, 0.6, 0.2), "arrived": (0.1, 0.6, 0.2), "avoid": (0.1, 0.4, 0.9)}
_HALTED = (0.9, 0.2, 0.1)  # colour of all other actions: wait, brake, step-back, step-aside, stuck


class _Writer:
    """The markers of one message."""

    def __init__(self, t: float, make: Make, frame: str) -> None:
        self.make, self.header = make, convert.header_message(t, frame, make)
        self.markers: list[Any] = []
        self.add("", convert.ARROW, action=convert.DELETE_ALL)

    def add(self, space: str, kind: int, **about: Any) -> None:
        """Add a marker with its index in the message as its id; `about` is as in `marker_message`."""
        self.markers.append(convert.marker_message(len(self.markers), kind, self.header, self.make, space=space, **about))

    def message(self) -> Any:
        return self.make("visualization_msgs/msg/MarkerArray", markers=self.markers)


def decision_message(decision: Decision, xy: XY, tracks: Tracks, t: float, make: Make = plain, *, frame: str = "map") -> Any:
    """Return `decision`, made at `xy` m and `t` s among `tracks`, as a MarkerArray of these namespaces, after a delete-all.

    action: its name and reason in words over the robot; motion: the planned path; target: where the detour ends;
    obstacle: a line from the robot to the obstacle that matters.
    """
    writer, colour = _Writer(t, make, frame), _COLOURS.get(decision.action, _HALTED)
    words = f"{decision.action}: {decision.reason}"
    writer.add("action", convert.TEXT, xy=xy, z=1.0, size=(0.0, 0.0, 0.25), colour=colour, text=words)
    if decision.path is not None and len(decision.path.xy) > 1:
        writer.add("motion", convert.LINE_STRIP, size=(0.05, 0.0, 0.0), colour=colour, points=decision.path.xy.tolist())
    if decision.local_target is not None:
        writer.add("target", convert.CYLINDER, xy=decision.local_target, size=(0.2, 0.2, 0.05), colour=colour)
    for place in tracks.xy[tracks.id == decision.obstacle].tolist():
        writer.add("obstacle", convert.LINE_STRIP, size=(0.03, 0.0, 0.0), colour=_HALTED, points=[xy, place])
    return writer.message()


def predictions(tracks: Tracks, grid: Grid, horizon: float) -> list[NDArray[np.float64]]:
    """Return where each track will be from now to `horizon` s at constant velocity, mirrored at walls.

    For each track these are rows t in s, x and y in m, float64[M, 3].
    """
    discs = np.column_stack((tracks.xy, np.nan_to_num(tracks.velocity), tracks.radius))
    tubes = Tubes.predict(0.0, 0.0, discs, grid, horizon)
    return [np.column_stack(tubes.knots(k)) for k in range(len(tracks))]


def predictions_message(
    tracks: Tracks, lines: list[NDArray[np.float64]], t: float, make: Make = plain, *, frame: str = "map"
) -> Any:
    """Return predictions (see `predictions`) as a MarkerArray: a line for each track, and its disc every second, fading."""
    writer = _Writer(t, make, frame)
    for line, radius in zip(lines, tracks.radius.tolist()):
        if len(line) < 2:
            continue
        writer.add("paths", convert.LINE_STRIP, size=(0.03, 0.0, 0.0), colour=convert.OBSTACLE, points=line[:, 1:].tolist())
        for when in np.arange(1.0, line[-1, 0] + 1e-9):
            x, y = (float(np.interp(when, line[:, 0], line[:, i])) for i in (1, 2))
            size, alpha = (2 * radius, 2 * radius, 0.02), float(0.5 * (1.0 - when / (line[-1, 0] + 1.0)))
            writer.add("places", convert.CYLINDER, xy=(x, y), size=size, colour=convert.OBSTACLE, alpha=alpha)
    return writer.message()


def shades(row: int, col: int, tau: NDArray[np.float32], grid: Grid, frame: Pose) -> tuple[NDArray[np.int8], Pose]:
    """Return pheromone in a window of `grid` from (row, col) on as costs from 0 to 100, and its corner's pose in `frame`."""
    corner = grid.origin[0] + col * grid.resolution, grid.origin[1] + row * grid.resolution, 0.0
    return np.rint(100.0 * tau / max(float(tau.max()), 1e-30)).astype(np.int8), chain(frame, corner)


class Pictures:
    """Publishers of what `pilot` plans, in `frame`; `publisher` opens one by type, topic and whether it is latched."""

    def __init__(self, pilot: Pilot, frame: str, publisher: Callable[[str, str, bool], Any]) -> None:
        self.pilot, self.frame = pilot, frame
        self.shown: Decision | None = None
        self.plan = publisher("nav_msgs/msg/Path", "plan", True)
        self.pheromone = publisher("nav_msgs/msg/OccupancyGrid", "pheromone", True)
        self.decisions = publisher("visualization_msgs/msg/MarkerArray", "decisions", True)
        self.predictions = publisher("visualization_msgs/msg/MarkerArray", "predictions", False)

    def show(self, t: float) -> None:
        """Publish decision, planned motion and pheromone if they are new, and predictions if there is a subscriber."""
        pilot, frame = self.pilot, self.frame
        decision = pilot.decision()
        if decision is None or pilot.scan is None or pilot.odometry is None:
            return
        tracks = pilot.scan[1]
        if decision is not self.shown:
            self.shown = decision
            self.decisions.publish(decision_message(decision, pilot.odometry.xy, tracks, t, make, frame=frame))
            if decision.path is not None:
                self.plan.publish(convert.path_message(decision.path.xy, make, t=t, frame=frame))
            costs, policy = pilot.pheromone(), pilot.policy
            if costs is not None and policy is not None:  # which may drive on a map before the newest one
                message = convert.costs_message(costs[0], policy.task.grid.resolution, costs[1], make, t=t, frame=frame)
                self.pheromone.publish(message)
        if self.predictions.get_subscription_count():
            lines = pilot.predictions(SEEN_AHEAD)
            self.predictions.publish(predictions_message(tracks, lines, t, make, frame=frame))
