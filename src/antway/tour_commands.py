"""The commands for tours; each imports what it needs when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from antway.console import OUT_OF_BUDGET, Json, Seed, number_option, pair, print_json, print_tour, working


def add_to(app: typer.Typer) -> None:
    """Add the commands to `app`."""
    app.command("tour")(tour_command)


def tour_command(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="ROS .yaml, .pgm, .png, .map, .txt or .npy.")],
    start: Annotated[str, typer.Option(metavar="X,Y", help="Where from, in m.")],
    stops: Annotated[
        Path,
        typer.Option(metavar="FILE", help="A table: x,y and, if wanted, name,earliest,latest,service,priority in its heading."),
    ],
    end: Annotated[str | None, typer.Option(metavar="X,Y|start", help="Where to end; without it, at the last stop.")] = None,
    robots: Annotated[int, number_option("robots", int, "K", "Robots that share the stops.")] = 1,
    objective: Annotated[str, typer.Option(metavar="NAME", help="travel-time, or makespan: when the last robot is done.")] = (
        "travel-time"
    ),
    deadline: Annotated[float, number_option("deadline", float, "S", "By when every robot must be done, in s.")] = float("inf"),
    speed: Annotated[float, number_option("speed", float, "M/S", "How fast a robot drives, in m/s.")] = 1.0,
    radius: Annotated[float, number_option("radius", float, "M", "The robot's radius in m.")] = 0.0,
    moves: Annotated[
        str, typer.Option(metavar="NAME", help="four, eight, eight-nosqueeze, eight-cut, sixteen or thirty-two.")
    ] = "eight",
    resolution: Annotated[
        float | None, number_option("resolution", float, "M", "Edge of a cell in m, for maps that do not say.")
    ] = None,
    seconds: Annotated[float, number_option("seconds", float, "S", "How long to look for the order.")] = 1.0,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the tour: .png, .svg or .pdf.")] = None,
    json: Json = False,
) -> int:
    """Visit many places on a map in the best order; exit status 4 if a window or the deadline is missed."""
    from antway import Moves, check_tour, checks, load_map, plan_tour
    from antway.tours.records import tour_record
    from antway.tours.stopfile import load_stops

    rule = Moves(checks.choice("moves", moves, [m.value for m in Moves]))
    listed = load_stops(stops)
    with working("planning"):
        tour = plan_tour(
            load_map(map_file, resolution=resolution),
            pair("start", start, float),
            listed.stops,
            end=end if end in (None, "start") else pair("end", end, float),
            deadline=deadline,
            robots=robots,
            objective=objective.replace("-", " "),
            speed=speed,
            robot_radius=radius,
            moves=rule,
            seconds=seconds,
            seed=seed,
            **listed.arguments(),
        )
        check_tour(tour)
    if out is not None:
        from antway.view import tours
        from antway.view.style import save

        with working("drawing"):
            save(tours.plan_tour_figure(tour), out)
    if json:
        print_json(tour_record(tour))
    else:
        print_tour(tour)
        if out is not None:
            print(f"drawn in {out}")
    return 0 if tour.feasible else OUT_OF_BUDGET
