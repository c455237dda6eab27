"""Plan in metres on a map in ROS format, check the answer, and draw it."""

import tempfile
from pathlib import Path

import numpy as np

import antway
from antway.view.figures import plan_figure, save

folder = Path(tempfile.mkdtemp())
walls = np.zeros((60, 80), dtype=bool)
walls[20:22, :60] = walls[40:42, 20:] = True
antway.save_map(antway.Grid(walls, resolution=0.1), folder / "hall.yaml")  # and hall.pgm beside it

grid = antway.load_map(folder / "hall.yaml")
plan = antway.plan(grid, (1.0, 0.5), (7.0, 5.5), robot_radius=0.25)
print(f"{plan.status.value}: {plan.length:.2f} m, the shortest: {plan.optimal}")

inflated = grid.inflate(0.25)  # the same by hand: only cells where the robot fits are free
problem = antway.Problem(inflated, inflated.cell_at((1.0, 0.5)), inflated.cell_at((7.0, 5.5)))
antway.check_plan(problem, plan)  # raises InvalidPlan, with every reason, if the answer is not legal

field = antway.distance_field(inflated, problem.goal)
print(f"distance from the start, by the distance field: {field[problem.start]:.2f} m")
print("drawn in", save(plan_figure(grid, plan), folder / "plan.svg"))
