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
from typing import Annotated, Any

import typer

from antway.errors import BadInput, BadParameter

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
    seed: Seed = 0,
    time_limit: Annotated[float | None, _number("time_limit", float, "S", "Stop after this many seconds.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the plan: .png, .svg or .pdf.")] = None,
    json: Json = False,
) -> int:
    """Plan a path on a map; exit status 3 if there is none, 4 if time ran out."""
    from antway import Moves, Problem, Status, check_plan, checks, load_map, solve

    ends = [_pair(name, text, int if cells else float) for name, text in (("start", start), ("goal", goal))]
    rule = Moves(checks.choice("moves", moves, [m.value for m in Moves]))
    with _working("planning"):
        grid = load_map(map_file)
        room = grid.inflate(radius)
        source, target = (end if cells else room.cell_at(end) for end in ends)
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
        print(f"{path.length:.3f} m, {proof}; {path.expanded} nodes expanded in {1000 * path.elapsed:.2f} ms")
    else:
        print("no path" if path.status is Status.NO_PATH else "no path found within the time limit")
    if out is not None and not json:
        print(f"drawn in {out}")
    return {Status.FOUND: 0, Status.NO_PATH: NO_PATH, Status.BUDGET: OUT_OF_BUDGET}[path.status]


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
