"""What the ROS 2 node tells, and what it makes of odd messages, on a stand-in of rclpy; test_ros_node.py has the real one."""

from __future__ import annotations

import math
import signal
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from antway import Grid
from antway.ros2 import convert
from antway.ros2.frames import HERE
from antway.ros2.nav2 import Failure, Kind
from antway.world.policy import Command, Tracks
from fake_ros import LifecycleNode, node_module
from naive.laser import measured

ROOM = Grid(np.zeros((40, 40), bool), 0.2)


@pytest.fixture
def made(monkeypatch):
    """Makes a node with some parameters, configured and active unless it is not to be."""

    def make(configure: bool = True, **given):
        module = node_module(monkeypatch)
        monkeypatch.setattr(LifecycleNode, "overrides", {"robot.drive": "holonomic"} | given)
        node = module.AntwayNode({})
        if configure:
            assert node.on_configure(None).name == "SUCCESS", node.said
            node.on_activate(None)
        return node

    return make


def odometry(t: float, xy=(2.0, 2.0), frame: str = "map"):
    """A nav_msgs/msg/Odometry of a robot that stands."""
    twist = SimpleNamespace(linear=SimpleNamespace(x=0.0, y=0.0), angular=SimpleNamespace(z=0.0))
    pose = convert.pose_message(*xy, 0.0)
    return SimpleNamespace(
        header=convert.header_message(t, frame), pose=SimpleNamespace(pose=pose), twist=SimpleNamespace(twist=twist)
    )


def goal(x: float, y: float):
    return SimpleNamespace(header=convert.header_message(0.0, "map"), pose=convert.pose_message(x, y, 0.0))


def update(t: float, x: int, y: int, costs) -> SimpleNamespace:
    """A map_msgs/msg/OccupancyGridUpdate."""
    costs = np.array(costs, np.int8)
    height, width = costs.shape
    return SimpleNamespace(
        header=convert.header_message(t, "map"), x=x, y=y, width=width, height=height, data=costs.ravel().tolist()
    )


def test_updates_change_a_part_of_a_costmap(made) -> None:
    """They come beside the map's topic, and count from its stamp on; one that came before the map counts if it is newer."""
    node = made()
    hear, told = node.heard_on["/one/map_updates"], []
    node.pilot.receive_map = told.append
    hear(update(3.0, 2, 1, [[100, -1], [0, 99]]))
    assert not told
    node.heard_on["map"](convert.grid_message(ROOM, t=2.0))
    hear(update(2.5, 0, 0, [[100]]))
    for t in (4.0, 4.5):
        hear(update(t, 2, 1, [[0]]))
    for wrong in (update(5.0, 39, 0, [[0, 0]]), update(5.0, -1, 0, [[0]]), update(5.0, 0, 0, [[101]])):
        hear(wrong)
        assert node.said[-1][0] == "error" and "map refused: OccupancyGrid" in node.said[-1][1]
    first, second = ROOM.blocked.copy(), ROOM.blocked.copy()
    first[1, 2:4] = second[1, 3] = True
    assert [(grid.blocked == blocked).all() for grid, blocked in zip(told, (first, second), strict=True)] == [True, True]
    assert told[0].unknown[1, 3] and told[0].unknown.sum() == 1


def test_a_goal_for_a_node_that_is_not_active_is_told(made) -> None:
    """A goal_pose that comes too early or too late is not dropped without a word."""
    node = made()
    node.on_deactivate(None)
    node.said.clear()
    node.heard_on["goal_pose"](goal(6.0, 2.0))
    assert node.said == [("warning", "goal_pose is ignored, because the node is not active")] and node.pilot.goal is None


def test_markers_that_only_delete_need_no_frame(made) -> None:
    """A delete-all marker without a frame, as it is by default, goes with obstacles in the map's, and with none."""
    node = made()
    one = Tracks(np.array([4]), np.array([[5.0, 6.0]]), np.array([[0.5, 0.0]]), np.array([0.3]))
    for t, tracks in ((1.0, one), (1.1, Tracks.none())):
        message = convert.markers_message(tracks, t)
        message.markers[0].header = convert.header_message(t, "")
        node.heard_on["obstacles"](message)
        assert node.pilot.scan[0] == pytest.approx(t) and node.pilot.scan[1].id.tolist() == tracks.id.tolist(), node.said


def test_a_node_that_ends_sees_to_it_that_its_stop_arrives(made) -> None:
    """A stop could be lost with a node that ended as soon as it had sent it, and the robot drove on."""
    node = made()
    node.heard_on["goal_pose"](goal(6.0, 2.0))
    node.on_shutdown(None)
    sent = node.published["cmd_vel"]
    assert not vars(sent.sent[-1].twist) and sent.acknowledged == len(sent.sent)


def test_odometry_whose_clock_stands_is_silent(made, monkeypatch) -> None:
    """Odometry that keeps on coming with the same stamp stops the robot, as if it did not come."""
    node = made()
    now = iter(np.arange(1.0, 100.0, 0.05).tolist())
    monkeypatch.setattr("time.monotonic", lambda: next(now))
    node.heard_on["map"](convert.grid_message(ROOM))
    node.heard_on["goal_pose"](goal(6.0, 2.0))
    node.pilot.command, node.pilot.guard = Command((1.0, 0.0)), None
    for _ in range(30):
        node.heard_on["odom"](odometry(5.0))
        node._watch()
    assert node.said[-1][0] == "error" and "odometry's stamp stays at 5.000 s" in node.said[-1][1], node.said
    twist = node.published["cmd_vel"].sent[-1].twist
    assert not vars(twist), "it stands"


def drives(made, **given):
    """A node that drives to a goal: (node, a function that sends odometry and an empty scene of a time)."""
    node = made(**given)

    def sense(t: float, xy=(2.0, 2.0)) -> None:
        node.heard_on["obstacles"](convert.markers_message(Tracks.none(), t))
        node.heard_on["odom"](odometry(t, xy))

    node.heard_on["map"](convert.grid_message(ROOM))
    node.heard_on["goal_pose"](goal(6.0, 2.0))
    sense(5.0)
    assert vars(node.published["cmd_vel"].sent[-1].twist), node.said
    return node, sense


def test_a_node_that_drives_brakes_when_odometry_is_late(made, monkeypatch) -> None:
    """Two periods after the last command at the latest; a simulation whose clock is slow is not late."""
    now = [10.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    node, sense = drives(made)
    for now[0] in (10.1, 10.19):
        node._watch()
        assert vars(node.published["cmd_vel"].sent[-1].twist)
    now[0] = 10.21
    node._watch()
    assert not vars(node.published["cmd_vel"].sent[-1].twist) and "no odometry for 2 control periods" in node.said[-1][1]
    node.simulated, node.time = True, 5.1
    sense(5.1)
    now[0], node.time = 10.6, 5.2
    node._watch()
    assert vars(node.published["cmd_vel"].sent[-1].twist)


@pytest.mark.parametrize(
    ("clock", "t", "refused"),
    [(106.0, 105.0, True), (105.3, 105.0, False), (0.6, 0.0, False), (1.8e9, 105.0, False), (0.0, 105.0, False)],
)
def test_odometry_that_comes_late_is_refused(made, clock: float, t: float, refused: bool) -> None:
    """Where the robot was a second ago is no place to drive from; stamps that are 0, or of another clock, tell nothing."""
    node = made()
    node.time = clock
    node.heard_on["odom"](odometry(t))
    assert (node.pilot.odometry is None) is refused
    assert any("age of header.stamp = '1.00 s'" in text and level == "error" for level, text in node.said) is refused


def test_the_command_to_stand_is_repeated_for_a_while(made, monkeypatch) -> None:
    """One that is lost leaves a robot driving; but not for ever, not to a robot with a goal, and not beside another driver."""
    now = [10.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    node, _ = drives(made)
    sent = node.published["cmd_vel"].sent
    for drivers, repeated in ((1, (4, 5, 6)), (2, (0,))):
        node.drivers = drivers
        node.drop("on request")
        count = len(sent)
        for _ in range(40):
            now[0] += 0.025
            node._watch()
        assert len(sent) - count in repeated and not any(vars(one.twist) for one in sent[count - 1 :])


def test_an_order_that_was_given_before_counts_no_more(made) -> None:
    """A tour whose order is found after the node was taken down and up again used to take the robot over."""
    node = made()
    before = node.orders
    node.drop("on request")
    node.on_deactivate(None)
    node.on_cleanup(None)
    assert node.on_configure(None).name == "SUCCESS" and node.orders > before + 1


def test_a_goal_that_is_refused_ends_the_drive(made) -> None:
    """Also if its frame is not known or it is not a number, and diagnostics go on telling that."""
    for wrong in (goal(math.nan, 2.0), SimpleNamespace(header=convert.header_message(0.0, "moon"), pose=goal(3.0, 3.0).pose)):
        node, sense = drives(made)
        node.heard_on["goal_pose"](wrong)
        assert node.pilot.goal is None and not vars(node.published["cmd_vel"].sent[-1].twist)
        for k in range(1, 10):
            sense(5.0 + 0.1 * k)
        node.reports.publish()
        status = node.published["/diagnostics"].sent[-1].status[0]
        assert status.level == b"\x02" and "goal_pose refused" in status.message


def test_a_stop_that_ends_something_is_a_success(made) -> None:
    """A tour that is being planned, and a robot that still brakes, count as well as a goal."""
    node = made()
    answer = SimpleNamespace
    assert node._serve_stop(None, answer()).success is False
    node.served.following = "a tour that is being planned"
    assert node._serve_stop(None, answer()).success is True
    node, _ = drives(made)
    assert node._serve_stop(None, answer()).success is True


def test_cycles_that_take_too_long_are_told(made, monkeypatch) -> None:
    """Diagnostics go on telling it for some seconds beside what the node does."""
    node, sense = drives(made)
    receive = node.pilot.receive_odometry
    monkeypatch.setattr(node.pilot, "receive_odometry", lambda *given: (time.sleep(0.15), receive(*given))[1])
    sense(5.1)
    assert any("a control cycle took 0." in text for _, text in node.said)
    monkeypatch.setattr(node.pilot, "receive_odometry", receive)
    sense(5.2)
    node.reports.publish()
    status = node.published["/diagnostics"].sent[-1].status[0]
    assert status.level == b"\x01" and status.message.startswith("follow") and "a control cycle took" in status.message


def test_parameters_show_the_robot_in_force(made) -> None:
    """Of a named robot they are its own numbers, once it is configured; what is set then counts from the next time on."""
    node = made(**{"robot.name": "turtlebot4", "robot.drive": "", "robot.latency": 0.2})
    assert (node.told["robot.v_max"], node.told["robot.drive"], node.told["robot.latency"]) == (0.31, "differential", 0.2)
    assert node.told["robot.footprint"] == "[]" and node.told["robot.brake_max"] == 0.0
    assert "robot.v_max" not in node.declared.values, "it is not set, so that another name brings its own"
    found = node.set_parameters_atomically([SimpleNamespace(name="robot.name", value="jackal")])
    assert found.successful and "next configure" in found.reason
    assert any("robot.name: it takes effect at the next configure" in text for _, text in node.said), "rclpy drops the reason"
    node.on_cleanup(None)
    assert node.on_configure(None).name == "SUCCESS" and node.told["robot.v_max"] == node.settings.robot.v_max == 2.0


def test_commands_that_nothing_takes_are_told(made) -> None:
    """A base that takes the other kind of twist does not move: the node says so, and which robot says it."""
    node = made()
    node.published["cmd_vel"].listeners = 0
    node.heard_on["goal_pose"](goal(6.0, 2.0))
    warned = [text for level, text in node.said if level == "warning"]
    assert len(warned) == 1 and "nothing takes geometry_msgs/msg/TwistStamped on /cmd_vel" in warned[0], node.said
    assert node.published["/diagnostics"].sent[-1].status[0].name == "one/antway"


@pytest.mark.parametrize(("step", "warned"), [(0.02, False), (0.05, False), (0.1, False), (0.07, True), (0.2, True)])
def test_odometry_at_rates_that_do_not_fit_is_told(made, step: float, warned: bool) -> None:
    """Commands are checked for robot.dt, 0.1 s: where odometry is slower than that, they act for longer."""
    node = made()
    for k in range(20):
        node.heard_on["odom"](odometry(5.0 + step * k))
    node.heard_on["goal_pose"](goal(6.0, 2.0))
    assert any(f"odometry comes each {step:.2f} s" in text for _, text in node.said) is warned, node.said


def test_what_goes_wrong_in_configure_is_told(made, monkeypatch) -> None:
    """Whatever is raised fails the transition with a reason, and leaves nothing open; a type that there is not is named."""
    node = made(configure=False)
    monkeypatch.setattr(node, "create_timer", lambda *_, **__: 1 / 0)
    assert node.on_configure(None).name == "FAILURE"
    assert node.said[-1] == ("error", "ZeroDivisionError: division by zero") and not node.parts and not node.compiling


def test_a_transition_that_raises_leaves_nothing_open(made) -> None:
    """After an error the node is not configured: it neither drives on nor holds topics that the next configure opens again."""
    node = made()
    node.heard_on["goal_pose"](goal(6.0, 2.0))
    node.done = lambda *_: 1 / 0
    with pytest.raises(ZeroDivisionError):
        node.on_deactivate(None)
    assert node.on_error(None).name == "SUCCESS" and not node.parts and not node.active


def test_it_can_be_ended_while_it_compiles(monkeypatch) -> None:
    """SIGINT ends a node that still compiles kernels, which may take minutes, and not only afterwards."""
    module = node_module(monkeypatch)
    monkeypatch.setattr(LifecycleNode, "overrides", {"robot.drive": "holonomic", "autostart": True})
    done = []

    def compile_for(settings) -> None:
        signal.raise_signal(signal.SIGINT)
        done.append(settings)

    monkeypatch.setattr(module, "compile_for", compile_for)
    before = signal.getsignal(signal.SIGINT)
    assert module.main([]) == 0 and not done
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no SIGHUP")
@pytest.mark.parametrize("ignored", [False, True])
def test_a_terminal_that_closes_ends_the_node_with_a_stop(monkeypatch, ignored: bool) -> None:
    """SIGHUP used to kill it, and the robot drove on; nohup, which ignores it, is obeyed."""
    module, seen = node_module(monkeypatch), []
    monkeypatch.setattr(LifecycleNode, "overrides", {"robot.drive": "holonomic", "autostart": True})
    monkeypatch.setattr(module.AntwayNode, "halt", lambda self, reason: seen.append(reason))

    def compile_for(settings) -> None:
        seen.append(signal.getsignal(signal.SIGHUP) is signal.SIG_IGN)
        signal.raise_signal(signal.SIGINT if ignored else signal.SIGHUP)

    monkeypatch.setattr(module, "compile_for", compile_for)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else lambda *_: seen.append("not handled"))
    try:
        assert module.main([]) == 0 and seen == [ignored, "shut down"]
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_tour_pre_empts_what_the_robot_drives_to(made, monkeypatch) -> None:
    """Whoever drove is told so at once, and the new tour can be cancelled; a bad tour leaves no drive that cannot be."""
    node, searches = made(), []
    monkeypatch.setattr("antway.ros2.tours.in_thread", lambda executor, work, answer: searches.append((work, answer)))
    kind = Kind(None, lambda goal: goal, lambda **fields: fields["error_code"], lambda **fields: fields)
    served, ends = sys.modules["antway.ros2.actions"].Served(node, {"visit_poses": kind}), []

    def visit(name: str, x: float) -> SimpleNamespace:
        handle = SimpleNamespace(goal_id=name, request=SimpleNamespace(poses=[goal(x, 2.0)], number_of_loops=0))
        handle.is_cancel_requested = handle.is_active = False
        handle.succeed = handle.abort = handle.canceled = print
        handle.execute = lambda end: ends.append((name, end(handle)))
        served._visit(handle)
        return handle

    node.heard_on["map"](convert.grid_message(ROOM))
    node.heard_on["odom"](odometry(5.0))
    first = visit("first", 6.0)
    searches[0][1]([0], None)
    assert node.pilot.goal is not None and not ends
    second = visit("second", 99.0)
    assert node.pilot.goal is None and ends == [("first", 601)]
    served.node.drop = lambda reason: ends.append(reason)
    answers = sys.modules["rclpy.action"].CancelResponse
    assert served._cancel(first) is answers.REJECT and served._cancel(second) is answers.ACCEPT
    searches[1][1](None, Failure(304, "off the map"))
    assert ends[1:] == ["the goal is cancelled", ("second", 602)] and served.following is None


@pytest.mark.parametrize(("result", "code"), [(SimpleNamespace(NO_VIAPOINTS_GIVEN=309), 309), (SimpleNamespace(), 308)])
def test_a_tour_of_nothing_has_nav2s_code(made, result, code: int) -> None:
    """The newer messages of Nav2 have a code for it."""
    node, ends = made(), []
    kind = Kind(SimpleNamespace(Result=result), lambda goal: goal, lambda **fields: fields, None)
    served = sys.modules["antway.ros2.actions"].Served(node, {"compute_tour": kind})
    node.heard_on["map"](convert.grid_message(ROOM))
    handle = SimpleNamespace(request=SimpleNamespace(goals=[], use_start=False), is_cancel_requested=False, abort=print)
    handle.execute = lambda end: ends.append(end(handle))
    served._compute_tour(handle)
    assert ends[0]["error_code"] == code and "at least one" in ends[0]["error_msg"]


@pytest.mark.parametrize(("fault", "code"), [(Failure(206, "in a wall"), 306), (RuntimeError("lost"), 300)])
def test_each_failure_of_a_tour_has_nav2s_code(made, monkeypatch, fault: Exception, code: int) -> None:
    """They are those of ComputePathThroughPoses; an unknown error used to have the code of ComputePathToPose."""
    node, ends, done = made(), [], threading.Event()

    def find(*_: object) -> None:
        raise fault

    monkeypatch.setattr("antway.ros2.actions.find_tour", find)
    node.executor = SimpleNamespace(create_task=lambda task, *found: (task(*found), done.set()))
    kind = Kind(None, lambda goal: goal, lambda **fields: fields, None)
    served = sys.modules["antway.ros2.actions"].Served(node, {"compute_tour": kind})
    node.heard_on["map"](convert.grid_message(ROOM))
    handle = SimpleNamespace(request=SimpleNamespace(goals=[goal(2.0, 2.0)], use_start=True, start=goal(1.0, 1.0)))
    handle.is_cancel_requested, handle.abort, handle.execute = False, print, lambda end: ends.append(end(handle))
    served._compute_tour(handle)
    assert done.wait(10.0)
    assert ends[0]["error_code"] == code


class Buffer:
    """A buffer of tf2_ros: it tells the latest of what it was told, and drops what is over 10 s older than that."""

    def __init__(self) -> None:
        self.stamps: list[float] = []

    def hear(self, t: float) -> None:
        if not self.stamps or t > max(self.stamps) - 10.0:
            self.stamps.append(t)

    def clear(self) -> None:
        self.stamps.clear()

    def lookup_transform(self, *_):
        if not self.stamps:
            raise LookupError("nothing heard")
        pose = convert.pose_message(1.0, 0.0, 0.0)
        move = SimpleNamespace(translation=pose.position, rotation=pose.orientation)
        return SimpleNamespace(header=convert.header_message(max(self.stamps), "map"), transform=move)


def test_tf_is_heard_anew_when_time_goes_back(made) -> None:
    """A bag that begins again stops no robot for as long as it took before; clocks that differ change nothing."""
    node, buffer = made(), Buffer()
    node.transforms.tf2, node.transforms.buffer = SimpleNamespace(TransformException=LookupError), buffer
    buffer.hear(503.0)
    node.heard_on["odom"](odometry(500.0, frame="odom"))
    assert "-3.00 s" in node.said[-1][1] and buffer.stamps and node.pilot.odometry is None
    buffer.clear()
    for start in (500.0, 20.0):
        for k in range(5):
            buffer.hear(start + 0.1 * k)
            node.heard_on["odom"](odometry(start + 0.1 * k, frame="odom"))
        assert node.pilot.odometry.t == pytest.approx(start + 0.4) and node.pilot.odometry.xy == (3.0, 2.0)


def test_a_goal_in_another_frame_before_odometry_is_told_so(made) -> None:
    """Without odometry no age of a transform is known; it was told as -500.00 s. A static one has no age."""
    node, buffer = made(), Buffer()
    node.transforms.tf2, node.transforms.buffer = SimpleNamespace(TransformException=LookupError), buffer
    message = goal(6.0, 2.0)
    message.header.frame_id = "odom"
    for stamp in (500.0, 0.0):
        buffer.stamps[:] = [stamp]
        node.heard_on["goal_pose"](message)
        assert (node.pilot.goal is None) == (stamp > 0.0) and "there is no odometry yet" in " ".join(
            said for _, said in node.said
        )
    assert node.pilot.goal.xy == (7.0, 2.0)


SCAN = {"angle_min": -math.pi, "angle_increment": math.pi / 360, "range_min": 0.05, "range_max": 8.0}


@pytest.mark.parametrize(("turned", "y"), [((0.0, 0.0, 0.0, 1.0), 2.0), ((1.0, 0.0, 0.0, 0.0), 6.0)])
def test_a_laser_may_be_mounted_upside_down(made, monkeypatch, turned, y: float) -> None:
    """What is to the right of a laser is to the left of the robot if the laser is upside down."""
    node = made(obstacles_type="sensor_msgs/msg/LaserScan")
    node.heard_on["map"](convert.grid_message(ROOM))
    right = measured(ROOM, np.array([[4.0, 2.0]]), np.array([0.4]), (4.0, 4.0, 0.0), 720, 3.0)
    q = SimpleNamespace(**dict(zip("xyzw", turned)))
    found = convert.read_mount(SimpleNamespace(position=SimpleNamespace(x=0.0, y=0.0), orientation=q))
    monkeypatch.setattr(node.transforms, "mount", lambda frame, *_: found if frame == "laser" else (HERE, False))
    node.heard_on["scan"](SimpleNamespace(header=convert.header_message(10.0, "laser"), ranges=right.tolist(), **SCAN))
    node.heard_on["odom"](odometry(10.0, (4.0, 4.0)))
    np.testing.assert_allclose(node.pilot.scan[1].xy, [[4.0, y]], atol=0.02)
