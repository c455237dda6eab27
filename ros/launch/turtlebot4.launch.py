"""antway drives a TurtleBot 4: `ros2 launch antway turtlebot4.launch.py`, beside its own bring-up and a map server."""

from __future__ import annotations

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

PARAMETERS = Path(__file__).resolve().parents[1] / "config" / "turtlebot4.yaml"


def generate_launch_description() -> LaunchDescription:
    """Start the node with the parameters of the robot; `params:=` names another file."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", default_value=str(PARAMETERS), description="Parameters of the node."),
            DeclareLaunchArgument("use_sim_time", default_value="false", description="Whether /clock is the time."),
            DeclareLaunchArgument("namespace", default_value="", description="Namespace of the node and its topics."),
            DeclareLaunchArgument("map", default_value="map", description="Topic of the map, or of a costmap."),
            DeclareLaunchArgument("odom", default_value="odom", description="Topic of the odometry."),
            DeclareLaunchArgument("scan", default_value="scan", description="Topic of the laser."),
            DeclareLaunchArgument("cmd_vel", default_value="cmd_vel", description="Topic of the commands."),
            Node(
                package="antway",
                executable="node",
                name="antway",
                namespace=LaunchConfiguration("namespace"),
                output="screen",
                parameters=[LaunchConfiguration("params"), {"use_sim_time": LaunchConfiguration("use_sim_time")}],
                remappings=[(topic, LaunchConfiguration(topic)) for topic in ("map", "odom", "scan", "cmd_vel")],
            ),
        ]
    )
