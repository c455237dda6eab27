"""Measure how much exact search beats ants on a map where nothing moves."""

import time

import numpy as np

import antway

rng = np.random.default_rng(1)
walls = rng.random((100, 100)) < 0.15
walls[:2, :2] = walls[-2:, -2:] = False
problem = antway.Problem(antway.Grid(walls), (0, 0), (99, 99))

print("planner      length      gap        time")
best = antway.solve(problem, "dijkstra").length
for planner, options in (("jps", {}), ("astar", {}), ("ants", {}), ("ants", {"heuristic": "goal"})):
    antway.solve(problem, planner, **options)  # compiles, or loads, the kernels
    started = time.perf_counter()
    plan = antway.solve(problem, planner, **options)
    took = 1000 * (time.perf_counter() - started)
    antway.check_plan(problem, plan)
    name = planner + (" (blind)" if options else "")
    print(f"{name:12}{plan.length:7.2f} m {100 * (plan.length / best - 1):6.2f} % {took:8.2f} ms")
