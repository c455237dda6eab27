"""What the node shows of its plans: decision, planned motion, pheromone and predictions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from antway.ros2 import convert
from antway.ros2.markers import decision_message, predictions_message
from antway.ros2.messages import make
from antway.ros2.pilot import Pilot
from antway.world.policy import Decision

SEEN_AHEAD = 3.0  # s; how far ahead predictions are shown


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
