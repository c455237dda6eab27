"""The command line: the only file that prints. A command imports what it needs when it runs, so that `--help` stays quick.

Exit status: 0 done, 1 interrupted output or a fault of antway's own, 2 wrong input, 3 no path, 4 out of budget, 5 contact in a
run, 130 interrupted. Answers go to stdout (with --json nothing else does), everything said on the way to stderr.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from antway.errors import BadInput, BadParameter, CellBlocked, OutOfBounds

if TYPE_CHECKING:
    from antway.grid import Grid

NO_PATH, OUT_OF_BUDGET, CONTACT = 3, 4, 5

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)


class Refused(Exception):
    """Carries a `BadInput` out of an option's parser; Typer would put words of its own round any `ValueError`."""


def _number(field: str, kind: type, metavar: str, help: str) -> Any:
    """An option that holds a number; text that is none is refused in the library's own words."""

    def parse(text: str) -> Any:
        try:
            return kind(text)
        except ValueError:
            raise Refused(BadParameter(field, text, "an integer" if kind is int else "a number")) from None

    return typer.Option(parser=parse, metavar=metavar, help=help)


Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else.")]
Seed = Annotated[int, _number("seed", int, "N", "Seed of every random choice: same seed, same answer.")]
RunSeed = Annotated[int | None, _number("seed", int, "N", "Seed of every random choice; without it, the scenario's.")]
PolicyName = Annotated[
    str, typer.Option(metavar="NAME", help="What steers the robot: antway, paper, follow, stop, replan, ...")
]


@app.callback(invoke_without_command=True)
def top(context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    """Robot path planning among moving obstacles."""
    if version:
        from antway import __version__

        print(f"antway {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


@app.command("plan")
def plan_command(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="ROS .yaml, .pgm, .png, .map, .txt or .npy.")],
    start: Annotated[str, typer.Option(metavar="X,Y", help="Where from, in m (with --cells: ROW,COL).")],
    goal: Annotated[str, typer.Option(metavar="X,Y", help="Where to, in m (with --cells: ROW,COL).")],
    cells: Annotated[bool, typer.Option("--cells", help="Start and goal are cells, ROW,COL.")] = False,
    planner: Annotated[str, typer.Option(metavar="NAME", help="dijkstra, astar, jps, anyangle, dstarlite or ants.")] = "jps",
    moves: Annotated[
        str, typer.Option(metavar="NAME", help="four, eight, eight-nosqueeze, eight-cut, sixteen or thirty-two.")
    ] = "eight",
    radius: Annotated[float, _number("radius", float, "M", "The robot's radius in m.")] = 0.0,
    resolution: Annotated[
        float | None, _number("resolution", float, "M", "Edge of a cell in m, for maps that do not say.")
    ] = None,
    seed: Seed = 0,
    time_limit: Annotated[float | None, _number("time_limit", float, "S", "Stop after this many seconds.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the plan: .png, .svg or .pdf.")] = None,
    json: Json = False,
) -> int:
    """Plan a path on a map; exit status 3 if there is none, 4 if time ran out."""
    from antway import Moves, Problem, Status, check_plan, checks, load_map, solve

    ends = {name: _pair(name, text, int if cells else float) for name, text in (("start", start), ("goal", goal))}
    rule = Moves(checks.choice("moves", moves, [m.value for m in Moves]))
    with _working("planning"):
        grid = load_map(map_file, resolution=resolution)
        room = grid.inflate(radius)
        source, target = (end if cells else _cell(name, end, grid, room, radius) for name, end in ends.items())
        problem = Problem(room, source, target, rule)
        path = solve(problem, planner, seed=seed, time_limit=time_limit)
        check_plan(problem, path)
    if out is not None:
        from antway.view import figures

        title = {Status.FOUND: "Plan", Status.NO_PATH: "No path", Status.BUDGET: "Out of budget"}[path.status]
        with _working("drawing"):
            figures.save(
                figures.plan_figure(grid, path, title=title, ends=(grid.centre(problem.start), grid.centre(problem.goal))), out
            )
    xy = path.xy(grid)
    if json:
        record = {
            "status": path.status.value,
            "planner": planner,
            "length": path.length,
            "optimal": path.optimal,
            "lower_bound": path.lower_bound,
            "expanded": path.expanded,
            "elapsed": path.elapsed,
            "cells": path.cells.tolist(),
            "xy": xy.tolist(),
        }
        _print_json(record)
    elif len(path.cells):
        proof = "the shortest" if path.optimal else f"at most {100 * path.gap:.1f} % over the shortest"
        print(f"{path.length:.3f} m, {proof}; {len(path.cells)} cells, {path.expanded} nodes expanded")
    else:
        print("no path" if path.status is Status.NO_PATH else "no path found within the time limit")
    if out is not None and not json:
        print(f"drawn in {out}")
    return {Status.FOUND: 0, Status.NO_PATH: NO_PATH, Status.BUDGET: OUT_OF_BUDGET}[path.status]


def _cell(name: str, xy: tuple[float, float], grid: Grid, room: Grid, radius: float) -> tuple[int, int]:
    """Return the cell that holds a point where the robot can stand; errors name the point as it was given."""
    try:
        cell = room.cell_at(xy)
    except OutOfBounds as error:
        raise OutOfBounds(name, xy, error.allowed) from None
    if room.blocked[cell]:
        near = "" if grid.blocked[cell] else f" with a radius of {radius:g} m; a wall or the map's edge is nearer"
        raise CellBlocked(name, xy, f"where the robot can stand{near or '; this cell is blocked'}")
    return cell


@app.command("run")
def run_command(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="A .toml file, or paper, office, warehouse.")],
    policy: PolicyName = "antway",
    seed: RunSeed = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write figures, replay page, trace and more.")] = None,
    json: Json = False,
) -> int:
    """Take a robot through a scenario; exit status 5 on a contact."""
    from antway import run
    from antway.demo import scene, summary, write_episode
    from antway.view.figures import shortest

    with _working("running"):
        place = scene(scenario)
        result = run(place, policy, seed=seed)
        if out is not None:
            numbers = write_episode(result, out)
        else:
            numbers = {"scenario": place.name, "policy": policy, **summary(result, shortest(place.task))}
    if json:
        _print_json(numbers)
    else:
        _print_table([(place.name, numbers)])
        print(f"{numbers['outcome']}: {numbers['reason']}")
        if out is not None:
            print(f"written to {out}")
    return CONTACT if numbers["outcome"].startswith("hit-") else 0


@app.command("demo")
def demo_command(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where to write.")] = Path("demo"),
    policy: PolicyName = "antway",
    seed: RunSeed = None,
    json: Json = False,
) -> int:
    """Play the paper's experiment on three scenes: figures, animations, replay pages and a table."""
    from rich.console import Console

    from antway.demo import run_demo

    console = Console(stderr=True)
    rows = []
    with console.status("starting") as status, _working("playing the scenes"):
        for name, numbers in run_demo(out, policy=policy, seed=seed, said=lambda name, what: status.update(f"{name}: {what}")):
            rows.append((name, numbers))
    if json:
        _print_json({"scenes": dict(rows), "out": str(out)})
    else:
        _print_table(rows)
        print(f"pictures in {out}; open {out / 'replay.html'} in a browser to play the episode")
    return CONTACT if any(numbers["outcome"].startswith("hit-") for _, numbers in rows) else 0


@app.command("view")
def view_command(
    trace_file: Annotated[Path, typer.Argument(metavar="TRACE", help="A trace.json that run or demo wrote.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Its suffix says what: .html, .gif, .mp4, .png, .svg or .pdf.")],
    at: Annotated[float | None, _number("at", float, "S", "For a picture: the moment, in s, instead of the whole way.")] = None,
) -> int:
    """Turn a trace into a replay page, an animation or a picture."""
    from antway.view import write_view

    with _working("drawing"):
        write_view(trace_file, out, at=at)
    print(f"written to {out}")
    return 0


def _print_table(rows: list[tuple[str, dict[str, Any]]]) -> None:
    """Print the summaries of episodes as a table."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="Robot among moving obstacles", title_justify="left")
    heads = ["scene", "policy", "outcome", "time", "driven", "over the\nshortest path", "waits", "re-plans"]
    for head in (*heads, "smallest\nclearance", "cycle ms\np50 / p99"):
        table.add_column(head, justify="left" if head in heads[:3] else "right")
    for name, n in rows:
        over = _shown(n["length_ratio"] and 100 * (n["length_ratio"] - 1), "+.1f", " %")
        table.add_row(
            name,
            n["policy"],
            f"[{'green' if n['reached'] else 'red'}]{n['outcome']}[/]",
            _shown(n["time"], ".1f", " s"),
            _shown(n["length"], ".2f", " m"),
            over,
            str(n["waits"]),
            str(n["replans"]),
            _shown(n["min_clearance"], ".2f", " m"),
            f"{_shown(n['cycle_ms_p50'], '.2f', '')} / {_shown(n['cycle_ms_p99'], '.2f', '')}",
        )
    Console(width=None if sys.stdout.isatty() else 120).print(table)


def _shown(value: float | None, form: str, unit: str) -> str:
    return "-" if value is None else f"{value:{form}}{unit}"


def _pair(name: str, text: str, kind: type) -> tuple[Any, Any]:
    """Read "A,B" as two numbers of `kind`."""
    wanted = "two integers ROW,COL" if kind is int else "two numbers X,Y (m)"
    try:
        values = [kind(part) for part in text.split(",")]
    except ValueError:
        raise BadParameter(name, text, wanted) from None
    if len(values) != 2:
        raise BadParameter(name, text, wanted)
    return values[0], values[1]


@contextmanager
def _working(what: str) -> Iterator[None]:
    """Say on stderr what is going on once it takes a second, and that kernels are being compiled when they are."""
    import threading

    from numba.core import event

    class Compiling(event.Listener):
        told = False

        def on_start(self, event: object) -> None:
            if not Compiling.told:
                Compiling.told = True
                _say("compiling the kernels; this happens once and is kept on disk ...")

        def on_end(self, event: object) -> None:
            pass

    late = threading.Timer(1.0, _say, (f"{what} ...",))
    late.daemon = True
    late.start()
    try:
        with event.install_listener("numba:compile", Compiling()):
            yield
    finally:
        late.cancel()


def _print_json(record: dict[str, Any]) -> None:
    """Print `record` as JSON; numbers that JSON lacks become null."""
    import json
    import math

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(part) for key, part in value.items()}
        if isinstance(value, (list, tuple)):
            return [plain(part) for part in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    print(json.dumps(plain(record), allow_nan=False))


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main() -> None:
    """Run the command line and exit with its status."""
    warnings.showwarning = lambda message, *_, **__: _say(f"warning: {message}")
    usage_error: Any = typer.BadParameter.__base__
    try:
        status = app(standalone_mode=False)
        sys.stdout.flush()
    except (BadInput, Refused) as error:
        _say(f"error: {error}")
        status = 2
    except usage_error as error:
        _say(f"error: {' '.join(error.format_message().split())}")
        status = 2
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            status = 1
        else:
            _say(f"error: {error}")
            status = 2
    except (KeyboardInterrupt, typer.Abort):
        _say("interrupted")
        status = 130
    sys.exit(status or 0)
