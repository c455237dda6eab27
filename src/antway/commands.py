"""The longer commands: tours, plans, fronts, smoothing, comparisons; each imports what it needs when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from antway.console import (
    MOVES,
    NO_PATH,
    OUT_OF_BUDGET,
    Json,
    MapFile,
    MovesName,
    Resolution,
    Seed,
    ended_by_interrupt,
    number_option,
    pair,
    path_option,
    picture_option,
    print_json,
    print_tour,
    say,
    search_bar,
    status_of_search,
    working,
)
from antway.errors import BadParameter, TooLarge
from antway.writing import writing

if TYPE_CHECKING:
    from antway.grid import Grid
    from antway.planning import Plan, Problem
    from antway.world.robots import RobotSpec


def tour_command(
    map_file: MapFile,
    start: Annotated[str, typer.Option(metavar="X,Y", help="Start in m.")],
    stops: Annotated[
        Path,
        typer.Option(metavar="FILE", help="CSV whose heading has x,y and optionally name,earliest,latest,service,priority."),
    ],
    end: Annotated[
        str | None, typer.Option(metavar="X,Y|start", help="Where the tour ends; at its last stop by default.")
    ] = None,
    robots: Annotated[int, number_option("robots", int, "K", "Number of robots that share the stops.")] = 1,
    objective: Annotated[
        str, typer.Option(metavar="NAME", help="What to minimise: travel-time, or makespan (when the last robot is done).")
    ] = ("travel-time"),
    deadline: Annotated[float, number_option("deadline", float, "S", "Time in s by which every robot must be done.")] = float(
        "inf"
    ),
    speed: Annotated[float, number_option("speed", float, "M/S", "Speed of a robot in m/s.")] = 1.0,
    radius: Annotated[float, number_option("radius", float, "M", "The robot's radius in m.")] = 0.0,
    moves: MovesName = "eight",
    resolution: Resolution = None,
    seconds: Annotated[float, number_option("seconds", float, "S", "Time for the search in s.")] = 1.0,
    seed: Seed = 0,
    out: Annotated[Path | None, picture_option("the tour")] = None,
    distances: Annotated[
        Path | None, path_option("distances", "FILE", "Write the distances among all stops, in m, to this .csv.", [".csv"])
    ] = None,
    json: Json = False,
) -> int:
    """Visit many places on a map in the best order; exit status 4 if a window or the deadline is missed."""
    from antway import Moves, check_tour, checks, load_map, plan_tour
    from antway.tours.plan import tour_record
    from antway.tours.stopfile import load_stops, save_distances

    rule = Moves(checks.choice("moves", moves, [m.value for m in Moves]))
    aim, seconds = _objective(objective), checks.number("seconds", seconds, low=0.0, unit="s")
    last = end if end in (None, "start") else pair("end", end, float, also=", or start")
    listed = load_stops(stops)
    with working("planning"):
        tour = plan_tour(
            load_map(map_file, resolution=resolution),
            pair("start", start, float),
            listed.stops,
            end=last,
            deadline=deadline,
            robots=robots,
            objective=aim,
            speed=speed,
            robot_radius=radius,
            moves=rule,
            seconds=seconds,
            seed=seed,
            **listed.arguments(),
        )
        check_tour(tour)
    if len(tour.skipped) == len(listed.stops):
        say("warning: every stop is left out, because its priority is 0 or the deadline is too near")
    if out is not None:
        from antway.view import tours
        from antway.view.style import save

        with working("drawing"):
            save(tours.plan_tour_figure(tour), out)
    if distances is not None:
        save_distances(tour.task, distances)
    if json:
        print_json(tour_record(tour))
    else:
        print_tour(tour)
        if out is not None:
            print(f"drawn in {out}")
    return 0 if tour.feasible else OUT_OF_BUDGET


def _objective(name: str) -> str:
    """Return the objective that an option names, as functions call it."""
    from antway import checks

    return checks.choice("objective", name, ("travel-time", "makespan")).replace("-", " ")


def tsptw_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Instance: n, n x n travel times, n windows.")],
    objective: Annotated[
        str, typer.Option(metavar="NAME", help="What to minimise: travel-time, or makespan (when the tour is back).")
    ] = "travel-time",
    seconds: Annotated[float, number_option("seconds", float, "S", "Stop after this many seconds.")] = 10.0,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Solve a travelling salesman problem with time windows.

    Exit status: 3 if no order is in time, 4 if none was found.
    """
    from antway import check_tsptw, checks, load_tsptw, solve_tsptw

    kind, seconds = _objective(objective), checks.number("seconds", seconds, low=0.0, unit="s")
    instance = load_tsptw(file)
    with working("searching"):
        solve_tsptw(instance, objective=kind, cycles=1, seed=seed)  # kernels are loaded before the clock starts
        result = solve_tsptw(instance, objective=kind, seconds=seconds, seed=seed)
        check_tsptw(instance, result.order, result.cost, objective=kind, feasible=result.feasible)
    if json:
        facts = "cost", "feasible", "lateness", "conflict", "proven", "bound", "cycles"
        record: dict[str, Any] = {"file": str(file), "objective": kind, "order": result.order.tolist()}
        record |= {name: getattr(result, name) for name in facts}
        print_json({**record, "seconds": result.elapsed})
    else:
        known = ""
        if result.feasible:
            known = ", no order is better" if result.proven else f", no order costs less than {result.bound:,.6g}"
        print(f"{kind} {result.cost:,.6g}{known}; {result.cycles:,} cycles in {result.elapsed:.2f} s")
        print("order " + " ".join(map(str, result.order.tolist())))
        if not result.feasible:
            print(f"late by {result.lateness:,.6g} in sum" + ("; no order is in time" if result.proven else ""))
        if result.conflict:
            print(f"cannot all be visited in time: {', '.join(map(str, result.conflict))}")
    return 0 if result.feasible else NO_PATH if result.proven else OUT_OF_BUDGET


def tsp_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A TSPLIB .tsp file.")],
    rule: Annotated[str, typer.Option(metavar="NAME", help="Colony rule: as, eas, rank, mmas or acs.")] = "mmas",
    local_search: Annotated[
        str | None, typer.Option(metavar="NAME", help="Local search: 2opt, oropt or 3opt; none by default.")
    ] = None,
    seconds: Annotated[float, number_option("seconds", float, "S", "Stop after this many seconds.")] = 10.0,
    seed: Seed = 0,
    threads: Annotated[int, number_option("threads", int, "N", "Threads; the answer does not depend on their number.")] = 1,
    out: Annotated[Path | None, picture_option("the tour and its convergence")] = None,
    json: Json = False,
) -> int:
    """Solve a travelling salesman problem by ants.

    Ctrl-C ends the search and keeps the best tour.
    """
    from functools import partial

    from antway import checks, load_tsp, solve_tsp
    from antway.warmup import twelve_cities

    seconds = checks.number("seconds", seconds, low=0.0, unit="s")
    instance = load_tsp(file)
    with ended_by_interrupt() as stop, search_bar(seconds) as show, working("searching"):

        def progress(tours: int, best: float, elapsed: float) -> None:
            gap = f", {100 * (best / instance.optimum - 1):.2f} % over the optimum" if instance.optimum else ""
            show(elapsed, f"best {best:,.6g}{gap}, {tours:,} tours")

        search = partial(solve_tsp, rule=rule, local_search=local_search, threads=threads, cancel=stop)
        # Kernels are loaded, and compiled once on a machine, before the clock starts: `seconds` are seconds of search.
        search(twelve_cities(), cycles=1)
        tour = search(instance, seconds=seconds, seed=seed, progress=progress)
    if out is not None:
        from antway.view import figures

        with working("drawing"):
            figures.save(figures.tour_figure(instance, tour, title=f"{instance.name}: {tour.length:,.6g}"), out)
    record = {
        "instance": instance.name,
        "cities": instance.size,
        **{name: getattr(tour, name) for name in ("length", "optimum", "gap", "tours", "elapsed")},
        "order": tour.order.tolist(),
    }
    if json:
        print_json(record)
        return 0
    gap = "" if tour.gap is None else f", {100 * tour.gap:.2f} % over the optimum"
    print(f"{instance.name}: {tour.length:,.6g}{gap}; {tour.tours:,} tours in {tour.elapsed:.1f} s")
    if out is not None:
        print(f"drawn in {out}")
    return 0


def print_plan(path: Plan, grid: Grid, problem: Problem, planner: str, out: Path | None, json: bool) -> int:
    """Print and draw a plan; see `antway plan`. JSON has lengths in m, cells as (row, column), and the path as (x, y) in m."""
    from antway import Status

    if out is not None:
        from antway.view import figures

        title = {Status.FOUND: "Plan", Status.NO_PATH: "No path", Status.BUDGET: "Out of budget"}[path.status]
        ends = grid.centre(problem.start), grid.centre(problem.goal)
        with working("drawing"):
            figures.save(figures.plan_figure(grid, path, title=title, ends=ends), out)
    if json:
        record = {"status": path.status.value, "planner": planner}
        record |= {name: getattr(path, name) for name in ("length", "optimal", "lower_bound", "expanded", "elapsed")}
        print_json({**record, "cells": path.cells.tolist(), "xy": path.xy(grid).tolist()})
    elif len(path.cells):
        kind = "at any angle" if path.points is not None else MOVES[problem.moves.value]
        proof = f"the shortest {kind}" if path.optimal else f"at most {100 * path.gap:.1f} % over the shortest {kind}"
        print(f"{path.length:.3f} m, {proof}; {len(path.cells)} cell{'' if len(path.cells) == 1 else 's'}")
    else:
        print("no path" if path.status is Status.NO_PATH else "no path found within the time limit")
    if out is not None and not json:
        print(f"drawn in {out}")
    return status_of_search(path.status)


def plan_front(
    problem: Problem,
    grid: Grid,
    radius: float,
    v_max: float | None,
    obstacles: str | None,
    seed: int,
    out: Path | None,
    json: bool,
) -> int:
    """Print the front of time, distance and clearance among the obstacles of a scenario; see `antway plan --pareto`."""
    from antway import Status, load_scenario
    from antway.ants.timed_front import MOST, OBJECTIVES, timed_front
    from antway.search.distance_field import distance_field

    with working("searching the front"):
        scenario = None if obstacles is None else load_scenario(obstacles)
        if scenario is not None:
            # The scenario's map may have other cells, and a turned map is up to a cell larger than before.
            apart = float(abs(grid.bounds() - scenario.world.grid.bounds()).max())
            if apart > 1.5 * max(grid.resolution, scenario.world.grid.resolution):
                raise BadParameter("obstacles", obstacles, "a scenario on this map, or on one of the same area")
        line = None if scenario is None else scenario.world.timeline(seed, scenario.horizon)
        speed = v_max or (1.0 if scenario is None else scenario.robot.v_max)
        away = float(distance_field(problem.grid, problem.goal, problem.moves)[problem.start])
        # Every move takes as long as the longest one, which is of 1.4 cells; half of that again is for detours and waiting.
        needs = 1.5 * away * float(problem.moves.lengths.max()) / speed
        horizon = min(max(60.0, needs if needs < float("inf") else 0.0), 1e5 if scenario is None else scenario.horizon)
        try:
            front = timed_front(problem, line, radius=radius, v_max=speed, horizon=horizon, seed=seed)
        except TooLarge as error:
            raise TooLarge("map", grid.shape, f"coarser: {error.allowed} within {horizon:g} s") from None
    if out is not None and len(front.paths):
        from antway.view.plans import front_figure
        from antway.view.style import save

        with working("drawing"):
            save(front_figure(grid, front, line), out)
    late = front.status is Status.NO_PATH and away < float("inf")
    status = Status.BUDGET if late else front.status
    if json:
        paths = [{"t": path.t.tolist(), "xy": path.xy.tolist()} for path in front.paths]
        print_json({"status": status.value, "objectives": OBJECTIVES, "front": front.values.tolist(), "paths": paths})
    else:
        for time, distance, clearance in front.values.tolist():
            more = " or more" if clearance == MOST else ""
            print(f"{time:8.2f} s  {distance:8.2f} m  {clearance:.2f} m{more} from moving obstacles")
        count = f"{len(front.paths)} path{'' if len(front.paths) == 1 else 's'}"
        says = {Status.FOUND: "all trade-offs found", Status.NO_PATH: "no path", Status.BUDGET: "there may be more"}[
            front.status
        ]
        print(f"{count}, {f'none arrives within {horizon:.4g} s at {speed:g} m/s' if late else says}")
        if out is not None and len(front.paths):
            print(f"drawn in {out}")
    return status_of_search(status)


def smooth_plan(path: Plan, grid: Grid, robot: RobotSpec, seed: int, out: Path | None, json: bool) -> int:
    """Print the motion of a robot along a plan; see `antway plan --smooth`."""
    from antway.trajectory.smooth import smooth

    with working("smoothing"):
        smooth(path, robot, grid=grid, trials=1)  # kernels are loaded before the clock starts
        found = smooth(path, robot, grid=grid, seed=seed)
    motion = found.motion
    if out is not None and motion is not None:
        from antway.view.plans import motion_figure
        from antway.view.style import save

        with working("drawing"):
            save(motion_figure(grid, path, found, robot), out)
    if json:
        record: dict[str, Any] = {"status": found.status.value, "length": path.length, "bent": found.bent}
        record |= {name: getattr(found, name) for name in ("reason", "bound", "stop_time", "elapsed")}
        if motion is not None:
            names = ("t", "xy", "heading", "velocity", "turn_rate")
            record |= {
                "time": motion.time,
                "motion_length": motion.length,
                "motion": {name: getattr(motion, name).tolist() for name in names},
            }
        print_json(record)
    elif motion is None:
        print(f"no motion found: {found.reason}")
    else:
        print(f"{motion.time:.2f} s, {motion.length:.2f} m, {found.how}")
        if found.bent and found.stop_time < float("inf"):
            print(f"{found.stop_time:.2f} s would be the motion with a stop at each corner")
        print(f"{found.bound:.2f} s would be the plan itself, {path.length:.2f} m, at full speed throughout")
        if out is not None:
            print(f"drawn in {out}")
    return NO_PATH if motion is None else 0


def compare_ants(runs: int, out: Path, json: bool) -> int:
    """Compare each ant method with its twins; see `antway bench ants`."""
    from dataclasses import asdict

    from antway.arena.ants import compare, markdown

    rows = []
    with working("comparing ants with their twins"):
        for row in compare(runs=runs):
            rows.append(row)
            say(markdown([row]).splitlines()[-1])
    with writing("out", out):
        out.mkdir(parents=True, exist_ok=True)
        (out / "ants.md").write_text(markdown(rows) + "\n", encoding="utf-8")
    if json:
        print_json({"comparisons": [asdict(row) for row in rows], "out": str(out)})
    else:
        print(markdown(rows))
    return 0


def refuse_unused(context: typer.Context, *used: str) -> None:
    """Refuse options of `antway bench` that are given, on the command line or elsewhere, and that its suite does not use."""
    for option in context.command.params:
        source, value = context.get_parameter_source(str(option.name)), context.params[str(option.name)]
        if option.name not in used and source is not None and source.name != "DEFAULT":
            allowed = f"left out with {context.params['suite']}, which does not use it"
            raise BadParameter(option.opts[0].lstrip("-"), str(value) if isinstance(value, Path) else value, allowed)


def predict(suite: str, file: Path | None, json: bool) -> int:
    """Measure how well a recording is predicted; see `antway bench predict`."""
    from dataclasses import asdict

    from antway.arena.predict import forecast, markdown

    if file is None or suite != "predict":
        raise BadParameter("file", None if file is None else str(file), "a recording, and only with predict")
    found = forecast(str(file))
    if json:
        print_json({"file": str(file), **asdict(found)})
        return 0
    print(markdown(found))
    print(f"{found.cases} forecasts from {file}")
    return 0
