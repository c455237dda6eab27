"""What antway uses of tf2_ros, which has no wheels, fed by TransformStamped on a topic (tf2_msgs has none either)."""

from __future__ import annotations

from geometry_msgs.msg import TransformStamped

from antway.ros2 import convert, frames
from antway.ros2.messages import make


class TransformException(Exception):
    """As tf2_ros raises."""


class Buffer:
    """The newest transform from each frame to its parent."""

    def __init__(self) -> None:
        self.known: dict[str, TransformStamped] = {}

    def clear(self) -> None:
        """Forget all."""
        self.known.clear()

    def lookup_transform(self, target_frame: str, source_frame: str, time) -> TransformStamped:
        """The pose of `source_frame` in `target_frame`, an ancestor of it; its stamp is the oldest that is not 0."""
        assert time.nanoseconds == 0, "the newest is asked for"
        pose, frame, stamps = frames.HERE, source_frame, []
        while frame != target_frame:
            if frame not in self.known:
                raise TransformException(f"no transform from {target_frame} to {source_frame}")
            one = self.known[frame]
            place = convert.plain("", position=one.transform.translation, orientation=one.transform.rotation)
            pose = frames.chain(convert.read_pose(place), pose)
            stamps.append(convert.seconds(one.header.stamp))
            frame = one.header.frame_id
        there = convert.pose_message(*pose, make)
        header = convert.header_message(min((s for s in stamps if s), default=0.0), target_frame, make)
        move = make(
            "geometry_msgs/msg/Transform",
            translation=make("geometry_msgs/msg/Vector3", x=there.position.x, y=there.position.y, z=0.0),
            rotation=there.orientation,
        )
        return TransformStamped(header=header, child_frame_id=source_frame, transform=move)


class TransformListener:
    """Puts what comes on the topic into a buffer."""

    def __init__(self, buffer: Buffer, node) -> None:
        self.node = node
        self.subscription = node.create_subscription(
            TransformStamped, "tf_stand_in", lambda m: buffer.known.update({m.child_frame_id: m}), 50
        )

    def unregister(self) -> None:
        """Stop listening."""
        self.node.destroy_subscription(self.subscription)
