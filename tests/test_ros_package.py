"""The files for a robot: parameters that the node knows, launch files that name them, layouts of topics that it has."""

from __future__ import annotations

import ast
import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import yaml

from antway.ros2.settings import Settings, described, parameters
from antway.version import __version__
from antway.world.policy import RobotSpec
from fake_ros import defaults

ROS = Path(__file__).resolve().parents[1] / "ros"
_NAMES = "map odom obstacles scan goal_pose cmd_vel plan pheromone decisions predictions diagnostics"
TOPICS = {f"/{name}" for name in _NAMES.split()}


def flat(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested parameters by their dotted names, as ROS reads them."""
    found: dict[str, Any] = {}
    for name, value in table.items():
        found |= flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return found


@pytest.mark.parametrize("file", sorted((ROS / "config").glob("*.yaml")), ids=lambda file: file.stem)
def test_parameter_files_are_accepted(file: Path) -> None:
    """Every parameter of a file is one of the node's in any namespace, and the node takes them together."""
    given = flat(yaml.safe_load(file.read_text(encoding="utf-8"))["/**/antway"]["ros__parameters"])
    assert given and set(given) <= set(parameters())
    settings = Settings.of(defaults() | ({"robot.drive": ""} if "robot.name" in given else {}) | given)
    if "robot.name" in given:
        assert settings.robot.wheels and settings.autostart


def test_launch_files_start_the_node_with_a_file_that_is_there() -> None:
    """They are Python that names this package, its executable and a parameter file that exists."""
    files = sorted((ROS / "launch").glob("*.launch.py"))
    assert [file.name for file in files] == ["turtlebot3.launch.py", "turtlebot4.launch.py"]
    for file in files:
        text = file.read_text(encoding="utf-8")
        declared = dict(re.findall(r'DeclareLaunchArgument\("(\w+)", default_value="?([^",)]*)', text))
        assert set(declared) == {"params", "namespace", "map", "odom", "scan", "cmd_vel", "use_sim_time"}
        assert all(declared[topic] == topic for topic in ("map", "odom", "scan", "cmd_vel"))  # relative: of its namespace
        assert re.findall(r"for topic in \((.*?)\)", text) == ['"map", "odom", "scan", "cmd_vel"']
        names = [node.name for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)]
        assert names == ["generate_launch_description"] and 'package="antway"' in text and 'executable="node"' in text
        assert (ROS / "config" / re.search(r'"config" / "([\w.]+)"', text)[1]).is_file()


def test_files_beside_nav2_ask_for_nothing_that_nobody_offers() -> None:
    """Nav2 does not come up if a tree of any of its navigators asks for an action that is missing; defaults ask for many."""
    page = (ROS.parent / "docs" / "ros2.md").read_text(encoding="utf-8")
    files = yaml.safe_load(re.search(r"```yaml\n(# antway.yaml\n.*?)```", page, re.DOTALL)[1])
    given = files["bt_navigator"]["ros__parameters"]
    assert given["navigators"] == ["navigate_to_pose"] and "plugin" in given["navigate_to_pose"]
    assert "default_nav_to_pose_bt_xml" in given
    tree = ET.fromstring(re.search(r"```xml\n(.*?)```", page, re.DOTALL)[1])
    leaves = {one.tag for one in tree.iter() if not len(one)}
    assert leaves == {"ComputePathToPose", "FollowPath", "Wait"}  # antway offers the first two, Nav2's behaviours the last


def test_the_package_is_sound() -> None:
    """Name and version are the library's; the script is a program; CMake installs what is there."""
    package = ET.parse(ROS / "package.xml").getroot()
    assert package.findtext("name") == "antway" and package.findtext("version") == __version__
    assert (ROS / "node").stat().st_mode & 0o111 and "antway.ros2.node" in (ROS / "node").read_text(encoding="utf-8")
    cmake = (ROS / "CMakeLists.txt").read_text(encoding="utf-8")
    assert all(name in cmake and (ROS / name).exists() for name in ("node", "launch", "config"))


def test_layouts_show_topics_that_the_node_has() -> None:
    """RViz and Foxglove subscribe to the node's topics and publish its goals."""
    rviz = yaml.safe_load((ROS / "config" / "antway.rviz").read_text(encoding="utf-8"))["Visualization Manager"]
    shown = [one["Topic"]["Value"] for one in [*rviz["Displays"], *rviz["Tools"]] if "Topic" in one]
    foxglove = json.loads((ROS / "config" / "foxglove.json").read_text(encoding="utf-8"))
    view = foxglove["configById"]["3D!antway"]
    assert set(shown) | set(view["topics"]) | {view["publish"]["poseTopic"]} <= TOPICS
    assert "/goal_pose" in shown and {"/plan", "/decisions"} <= set(shown)
    services = yaml.safe_load((ROS / "compose.yaml").read_text(encoding="utf-8"))["services"]
    assert set(services) == {"nav2", "antway"} and all(one["ipc"] == "host" for one in services.values())
    assert "..:/checkout:ro" in services["antway"]["volumes"] and "packages /checkout" in services["antway"]["command"]


def test_descriptions_say_what_a_parameter_does() -> None:
    """Each parameter has words of its own, those of its definition where it has one."""
    texts = {name: one.text for name, one in parameters().items()}
    assert all(len(text) > 10 and "Field " not in text and "Option " not in text for text in texts.values())
    assert texts["robot.dt"] == described(RobotSpec)["dt"] and "speed" in texts["robot.v_max"].lower()
    assert "map_occupied" in defaults()
