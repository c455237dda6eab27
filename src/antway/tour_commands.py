"""The commands for tours; each imports what it needs when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from antway.console import NO_PATH, OUT_OF_BUDGET, Json, Seed, number_option, pair, print_json, print_tour, working


def add_to(app: typer.Typer) -> None:
    """Add the commands to `app`."""
    app.command("tour")(tour_command)
    app.command("tsptw")(tsptw_command)


def tour_command(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="ROS .yaml, .pgm, .png, .map, .txt, .npy, or a scene.")],
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


def tsptw_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="An instance: n, n x n times, n windows.")],
    objective: Annotated[
        str, typer.Option(metavar="NAME", help="travel-time, or makespan: when the tour is back.")
    ] = "travel-time",
    seconds: Annotated[float, number_option("seconds", float, "S", "Stop after this many seconds.")] = 10.0,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Solve a travelling salesman problem with time windows; exit status 3 if no order is in time, 4 if none was found."""
    from antway import check_tsptw, checks, load_tsptw, solve_tsptw

    instance = load_tsptw(file)
    kind = checks.choice("objective", objective.replace("-", " "), ("travel time", "makespan"))
    with working("searching"):
        solve_tsptw(instance, objective=kind, cycles=1, seed=seed)  # kernels are loaded before the clock starts
        result = solve_tsptw(instance, objective=kind, seconds=seconds, seed=seed)
        check_tsptw(instance, result.order, result.cost, objective=kind, feasible=result.feasible)
    if json:
        print_json(
            {
                "file": str(file),
                "objective": kind,
                "order": result.order.tolist(),
                "cost": result.cost,
                "feasible": result.feasible,
                "lateness": result.lateness,
                "conflict": list(result.conflict),
                "proven": result.proven,
                "bound": result.bound,
                "cycles": result.cycles,
                "seconds": result.elapsed,
            }
        )
    else:
        known = "no order is better" if result.proven and result.feasible else f"no order costs less than {result.bound:,.6g}"
        print(f"{kind} {result.cost:,.6g}, {known}; {result.cycles:,} cycles in {result.elapsed:.2f} s")
        print("order " + " ".join(map(str, result.order.tolist())))
        if not result.feasible:
            print(f"late by {result.lateness:,.6g} in sum" + ("; no order is in time" if result.proven else ""))
        if result.conflict:
            print(f"cannot all be visited in time: {', '.join(map(str, result.conflict))}")
    return 0 if result.feasible else NO_PATH if result.proven else OUT_OF_BUDGET
