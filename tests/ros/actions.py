"""Run in the ROS environment beside tests/ros/stand_in.py: asks for every end that the two actions can have; prints them."""

from __future__ import annotations

import math

from action_msgs.msg import GoalStatus
from harness import end, start
from rclpy.action import ActionClient
from stand_in import GOALS, NAV2, START, distance, goal_message, kinds, numbers, room, server_of, waypoint

from antway.ros2.messages import load, make
from antway.world.policy import Observation, Tracks

STATUS = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_ABORTED: "aborted",
    GoalStatus.STATUS_CANCELED: "cancelled",
}


class Body:
    """A robot that does as it is told, in an empty room."""

    def __init__(self, robot) -> None:
        self.robot, self.t, self.xy, self.velocity, self.heading = robot, 1000.0, START, (0.0, 0.0), 0.0

    def observe(self) -> Observation:
        return Observation(self.t, self.xy, self.velocity, self.heading, Tracks.none())

    def step(self, over=lambda: False, moves: bool = True) -> None:
        """Drive for 0.1 s by what the node answers."""
        command = self.robot.answers(self.observe(), 0.0, over)
        self.t += 0.1
        if moves and not over():
            self.velocity = command.velocity
            self.xy = self.xy[0] + 0.1 * self.velocity[0], self.xy[1] + 0.1 * self.velocity[1]


class Asked:
    """A goal that was sent."""

    def __init__(self, robot, client, name: str, server: str) -> None:
        self.robot, self.feedback = robot, []
        sent = client.send_goal_async(goal_message(name, server), feedback_callback=lambda m: self.feedback.append(m.feedback))
        robot.until(f"goal '{name}'", sent.done)
        self.handle = sent.result()
        self.accepted = self.handle.accepted
        self.future = self.handle.get_result_async() if self.accepted else None

    def ended(self) -> bool:
        return self.future.done()

    def result(self) -> list:
        self.robot.until("a result", self.ended)
        answer = self.future.result()
        return [STATUS[answer.status], *numbers(answer.result)]


def main() -> None:
    robot = start()
    body, found = Body(robot), {}
    clients = {name: ActionClient(robot, kind.type, name) for name, kind in kinds().items()}
    for name, client in clients.items():
        robot.until(name, client.server_is_ready)

    def ask(name: str) -> Asked:
        server = server_of(name)
        return Asked(robot, clients[server], name, server)

    def drive(asked: Asked, **options) -> list:
        """Drive until the goal has ended."""
        for _ in range(2000):
            if asked.ended():
                break
            body.step(asked.ended, **options)
        return asked.result()

    def senses(**options) -> None:
        robot.senses(body.observe(), 0.0, **options)
        body.t += 0.1

    # plans: before there is a map, before there is odometry, and then every way in which they can end
    found["no map"] = ask("free").result()
    robot.charts(room())
    while ask("free").result()[0] != "succeeded":
        pass
    found["no odometry"] = ask("from here").result()
    for _ in range(3):
        senses()
    for name in list(GOALS)[:9]:
        found[name] = ask(name).result()
        while name == "from here" and found[name][0] != "succeeded":  # odometry is on its way
            found[name] = ask(name).result()
    for name in ("no such controller", "way on the moon", "no way"):
        found[name] = ask(name).result()

    # drives: into a wall; to the end, with feedback; cancelled; replaced by a way alike, by another goal, by one refused
    found["into the wall"] = drive(ask("into the wall"))
    asked = ask("way")
    found["way"] = drive(asked)
    lengths = [distance(one) for one in asked.feedback]
    assert len(lengths) > 50 and lengths[0] > 10.0 and lengths[-1] < 1.0, lengths[-3:]
    asked = ask("way back")
    for _ in range(10):
        body.step()
    moving = math.hypot(*body.velocity)
    cancelled = asked.handle.cancel_goal_async()
    robot.until("the cancel", cancelled.done)
    found["cancelled"] = asked.result()
    robot.until("a stop", robot.stands)
    first = ask("way back")
    for _ in range(5):
        body.step()
    answered, standing = robot.answered, robot.stands()
    asked = ask("way back")
    found["refreshed"] = first.result()
    robot.until("the refreshed path", lambda: any("refreshed" in text for _, text in robot.printed))
    for _ in range(5):
        body.step()
        standing = standing or robot.stands()
    robot.go(START)
    robot.until("pre-emption", asked.ended)
    found["replaced by goal_pose"] = asked.result()
    asked = ask("way back")
    for _ in range(5):
        body.step()
    found["refused on the way"] = ask("no way").result()
    found["ended by one that is refused"] = asked.result()
    robot.until("a stop", robot.stands)
    found["drove"] = [moving > 0.1, robot.answered > answered, not standing]

    # tours: planned, driven to the end, cancelled, and refused
    for name in ("tour", "tour into the wall", "visit a closet"):
        found[name] = ask(name).result()
    robot.go(START)
    for _ in range(300):
        if math.dist(body.xy, START) < 0.3:
            break
        body.step(lambda: math.dist(body.xy, START) < 0.3)
    asked = ask("visit")
    found["visit"] = drive(asked)
    found["visited"] = list(dict.fromkeys(waypoint(one) for one in asked.feedback))
    asked = ask("visit and be cancelled")
    for _ in range(5):
        body.step()
    cancelled = asked.handle.cancel_goal_async()
    robot.until("the cancel", cancelled.done)
    found["visit and be cancelled"] = asked.result()
    robot.until("a stop", robot.stands)

    # patience and progress
    asked = ask("way")
    body.step()
    robot.until("patience's end", asked.ended, lambda: [senses(obstacles=False) for _ in range(5)])
    found["silent"] = asked.result()
    asked = ask("way")
    found["stuck"] = drive(asked, moves=False)

    # down and up again, and shut down, while a goal is being driven to
    change = robot.create_client(load("lifecycle_msgs/srv/ChangeState"), "/antway/change_state")
    robot.until("change_state", change.service_is_ready)

    def transition(number: int) -> None:
        request = make("lifecycle_msgs/srv/ChangeState_Request", transition=make("lifecycle_msgs/msg/Transition", id=number))
        future = change.call_async(request)
        robot.until("transition", future.done)
        assert future.result().success, number

    asked = ask("way")
    body.step()
    transition(4)  # deactivate
    found["deactivated"] = asked.result()
    found["inactive"] = [ask(name).accepted for name in ("free", "way")]
    transition(3)  # activate
    found["active"] = ask("free").result()
    asked = ask("way")
    body.step()
    transition(7)  # shut down
    found["shut down"] = asked.result()
    end(robot, nav2=NAV2, ends=found)


if __name__ == "__main__":
    main()
