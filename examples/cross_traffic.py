"""Let a robot cross a hall in which people walk, and write a page that replays it in a browser."""

import tempfile
from pathlib import Path

import numpy as np

import antway
from antway.view.figures import shortest
from antway.view.replay import write_replay
from antway.world.motions import BackAndForth, Bounce
from antway.world.world import Obstacle

hall = np.zeros((60, 100), dtype=bool)
hall[:22, 48:52] = hall[38:, 48:52] = True
people = [Obstacle(0.3, BackAndForth((2.2 + 0.7 * k, 0.5), (2.2 + 0.7 * k, 5.5), speed=0.6 + 0.1 * k)) for k in range(4)]
people += [Obstacle(0.3, Bounce((8.0, 1.0 + k), speed=0.8)) for k in range(3)]
scenario = antway.Scenario(
    antway.World(antway.Grid(hall, resolution=0.1), tuple(people)),
    start=(1.0, 3.0),
    goal=(9.0, 3.0),
    robot=antway.RobotSpec(radius=0.25, v_max=1.0, sensor_range=4.0),
)
result = antway.run(scenario, policy="antway", seed=7)
antway.check_episode(result)  # raises InvalidPlan if the record breaks a rule of robot, map or obstacles
print(f"{result.outcome.value} in {result.time:.1f} s, {result.length:.2f} m, nearest {result.min_clearance:.2f} m")
print("open", write_replay(result.trace, Path(tempfile.mkdtemp()) / "replay.html", shortest=shortest(scenario.task)))
