"""Visit eight places of the office that comes with antway, two of them at certain times."""

import tempfile
from pathlib import Path

import antway
from antway.view.style import save
from antway.view.tours import plan_tour_figure

STOPS = {  # name: (x, y) in m, (earliest, latest) in s or None
    "kitchen": ((4.0, 11.0), None),
    "lab": ((9.0, 11.5), (40.0, 80.0)),
    "printer": ((15.0, 2.5), None),
    "lobby": ((20.0, 7.0), None),
    "archive": ((4.0, 2.5), None),
    "meeting": ((20.0, 11.0), (0.0, 50.0)),
    "copier": ((8.5, 2.5), None),
    "store": ((20.0, 3.0), None),
}
grid = antway.load_map("office")
places, windows = [xy for xy, _ in STOPS.values()], [window for _, window in STOPS.values()]
how = {"names": list(STOPS), "windows": windows, "service": 5.0, "robot_radius": 0.25, "seed": 1}
tour = antway.plan_tour(grid, (1.5, 7.0), places, end="start", seconds=0.5, **how)
antway.check_tour(tour)
for stop, arrival, waiting in zip(tour.order, tour.arrival, tour.waiting):
    print(f"{arrival:6.1f} s  {tour.task.names[stop]:8}{f'waits {waiting:.1f} s' if waiting else ''}")
print(f"{tour.length:.1f} m in {tour.duration:.1f} s, {'all in time' if tour.feasible else 'late'}")
print("drawn in", save(plan_tour_figure(tour), Path(tempfile.mkdtemp()) / "tour.png"))
