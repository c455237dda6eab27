"""Write your own policy, and let it play the paper's scene beside the two that come with antway."""

import math

import antway


class Timid:
    """Drives along the shortest path, and stands still while something is within two metres."""

    def reset(self, task: antway.Task, seed: int) -> None:
        plan = antway.plan(task.grid, task.start, task.goal, robot_radius=task.robot.radius)
        self.task, self.path = task, [tuple(xy) for xy in plan.xy(task.grid)] + [task.goal]

    def act(self, seen: antway.Observation) -> antway.Command:
        near = [math.dist(seen.xy, xy) for xy in seen.tracks.xy]
        if min(near, default=math.inf) < 2.0:
            self.decision = antway.Decision("wait", f"something is {min(near):.1f} m away")
            return antway.Command((0.0, 0.0))
        while len(self.path) > 1 and math.dist(seen.xy, self.path[0]) < 0.05:
            self.path.pop(0)
        far = math.dist(seen.xy, self.path[0])
        speed = min(self.task.robot.v_max, far / self.task.robot.dt)
        self.decision = antway.Decision("follow", "the path is free")
        return antway.Command(tuple(speed * (b - a) / far if far else 0.0 for a, b in zip(seen.xy, self.path[0])))

    def explain(self) -> antway.Decision:
        return self.decision


for policy in (Timid(), "paper", "antway"):
    result = antway.run(antway.load_scenario("paper"), policy, seed=3)
    name = policy if isinstance(policy, str) else "timid"
    print(f"{name:8}{result.outcome.value:14}{result.time:6.1f} s, nearest {result.min_clearance:.2f} m")
