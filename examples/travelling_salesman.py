"""Let ants look for the shortest closed tour through cities, the paper's first problem."""

import tempfile
from pathlib import Path

import numpy as np

import antway
from antway.ants.tsp import Tsp
from antway.view.figures import save, tour_figure

rng = np.random.default_rng(0)
cities = Tsp(rng.random((80, 2)) * 100, name="eighty cities")
for rule in ("as", "eas", "rank", "mmas", "acs"):
    tour = antway.solve_tsp(cities, rule=rule, cycles=200, seed=1)
    print(f"{rule:5}{tour.length:8.2f}")
tour = antway.solve_tsp(cities, rule="mmas", local_search="3opt", cycles=50, seed=1)
print(f"mmas with 3-opt {tour.length:8.2f}, {tour.tours} tours in {tour.elapsed:.2f} s")
print("drawn in", save(tour_figure(cities, tour), Path(tempfile.mkdtemp()) / "tour.png"))
