"""Shared by the commands: options with numbers, progress on stderr, answers on stdout, and the exit status."""

from __future__ import annotations

import errno
import io
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from antway.errors import BadInput, BadParameter, described_error
from antway.tables import PLANNERS, SHIPPED_SCENES, names
from antway.writing import PICTURES, check_target

if TYPE_CHECKING:
    import threading

    from antway.arena.summary import Summary
    from antway.planning import Status
    from antway.tours.plan import TourPlan


FAULT, WRONG_INPUT, NO_PATH, OUT_OF_BUDGET, CONTACT, INTERRUPTED, UNREAD = 1, 2, 3, 4, 5, 130, 141  # exit statuses


def status_of(outcomes: Iterable[str]) -> int:
    """Return the exit status for episodes with these outcomes: the worst of policy error, contact and timeout."""
    ends = set(outcomes)
    if "error" in ends:
        return FAULT
    if any(end.startswith("hit-") for end in ends):
        return CONTACT
    return OUT_OF_BUDGET if "timeout" in ends else 0


def status_of_search(status: Status) -> int:
    """Return the exit status for a search that ended with this status."""
    return {"found": 0, "no-path": NO_PATH, "budget": OUT_OF_BUDGET}[status.value]


class Refused(Exception):
    """Carries a `BadInput` out of an option's parser, because Typer would add its own text to a `ValueError`."""


class Fault(Exception):
    """Carries what a planner of somebody else raised, in one line."""


@contextmanager
def faults_named(planner: str) -> Iterator[None]:
    """Name in one line what a planner raised, unless it is one of antway's own, whose fault needs its traceback."""
    try:
        yield
    except BadInput:
        raise
    except Exception as error:
        if planner in PLANNERS:
            raise
        raise Fault(f"planner {planner}: {described_error(error)}") from error


def number_option(field: str, kind: type, metavar: str, help: str) -> Any:
    """Return an option with a number; other text is refused by the library's own error."""

    def parse(text: str) -> Any:
        try:
            return kind(text)
        except ValueError:
            raise Refused(BadParameter(field, text, "an integer" if kind is int else "a number")) from None

    return typer.Option(parser=parse, metavar=metavar, help=help)


def path_option(field: str, metavar: str, help: str, suffixes: Sequence[str] = ()) -> Any:
    """Return an option with a place to write to: a file with one of `suffixes`, or without them a folder."""

    def parse(text: str | Path) -> Path:
        try:
            return check_target(field, text, suffixes)
        except BadParameter as error:
            raise Refused(error) from None

    return typer.Option(parser=parse, metavar=metavar, help=help)


Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else.")]
Seed = Annotated[int, number_option("seed", int, "N", "Seed of every random choice: the same seed gives the same answer.")]


def completed(table: Iterable[str]) -> Callable[[str], list[str]]:
    """Return the function for shell completion with the names of `table`."""
    return lambda incomplete: [name for name in table if name.startswith(incomplete)]


def scene_argument(metavar: str, files: str) -> Any:
    """Return an argument that is a file or a shipped scene."""
    help = f"{files}, or a scene: {names(SHIPPED_SCENES)}."
    return typer.Argument(metavar=metavar, help=help, autocompletion=completed(SHIPPED_SCENES))


def name_option(table: Iterable[str], help: str) -> Any:
    """Return an option with a name, which the shell completes from `table`."""
    return typer.Option(metavar="NAME", help=help, autocompletion=completed(table))


def picture_option(what: str) -> Any:
    """Return the option --out of a command that draws `what`."""
    return path_option("out", "FILE", f"Draw {what}: .png, .svg or .pdf.", PICTURES)


MapFile = Annotated[Path, scene_argument("MAP", "ROS .yaml, .pgm, .png, .map, .txt, .npy")]
MOVES = {
    "four": "with four directions",
    "eight": "with eight directions",
    "eight-nosqueeze": "with eight directions that may cut one corner",
    "eight-cut": "with eight directions that cut corners",
    "sixteen": "with sixteen directions",
    "thirty-two": "with thirty-two directions",
}
MovesName = Annotated[str, name_option(MOVES, f"Moves between cells: {names(MOVES)}.")]
Resolution = Annotated[float | None, number_option("resolution", float, "M", "Edge of a cell in m, for maps that do not say.")]


def pair(name: str, text: str, kind: type, also: str = "") -> tuple[Any, Any]:
    """Read "A,B" as two numbers of `kind`; errors name what is allowed `also`."""
    wanted = ("two integers ROW,COL" if kind is int else "two numbers X,Y (m)") + also
    try:
        first, second = map(kind, text.split(","))
    except ValueError:  # also for more or fewer than two
        raise BadParameter(name, text, wanted) from None
    return first, second


@contextmanager
def working(what: str) -> Iterator[None]:
    """Print on stderr what is going on once it takes a second."""
    import threading

    late = threading.Timer(1.0, say, (f"{what} ...",))
    late.daemon = True
    late.start()
    try:
        yield
    finally:
        late.cancel()


@contextmanager
def search_bar(seconds: float) -> Iterator[Callable[[float, str], None]]:
    """Show on stderr how far a search of `seconds` s is, once it takes a second; yield what is called with (s, description)."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task("searching", total=seconds)

    def show(elapsed: float, description: str) -> None:
        if elapsed > 1.0:
            bar.start()
            bar.update(task, completed=elapsed, description=description)

    try:
        yield show
    finally:
        if bar.live.is_started:
            bar.stop()


@contextmanager
def episode_bar(suite: str, episodes: int) -> Iterator[Callable[[], None]]:
    """Show on stderr how many of the episodes of a suite are done; yield what is called after each.

    Where stderr is no terminal, as in the log of a job, that is a line at most each half minute, and one at the end.
    """
    import time

    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console, done, printed, start = Console(stderr=True), 0, 0.0, time.monotonic()

    def tell() -> None:
        nonlocal done, printed
        done, passed = done + 1, time.monotonic() - start
        if passed >= printed + 30.0 or done == episodes:
            printed = passed
            say(f"{suite}: {done} of {episodes} episodes after {passed:.0f} s")

    if not console.is_terminal:
        yield tell
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(escape(suite), total=episodes)
        yield lambda: bar.advance(task)


@contextmanager
def ended_by_interrupt() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C sets, so that a search ends with what it has found."""
    import signal
    import threading

    stop = threading.Event()
    before = signal.signal(signal.SIGINT, lambda *_: stop.set())
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)


def print_json(record: dict[str, Any]) -> None:
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


def say(line: str) -> None:
    """Print a line on stderr."""
    print(line, file=sys.stderr, flush=True)


Cell = str | tuple[str, str]  # text, or text and its colour
_PROSE = 20  # characters; least width of a column of prose


def _print_cells(title: str, heads: Sequence[str], left: str, rows: Iterable[Sequence[Cell]], long: Sequence[str] = ()) -> None:
    """Print a table, or a line for each cell but dashes in a terminal that is too narrow for it.

    The columns named in `left` are aligned left, and the text of those in `long` alone is broken, into two lines or prose.
    """
    from rich.cells import cell_len
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    cells = [[Text(cell) if isinstance(cell, str) else Text(*cell) for cell in row] for row in rows]
    table, needs = Table(title=title, title_justify="left"), 1
    for head, *column in zip(heads, *cells):
        table.add_column(head, justify="left" if head in left.split() else "right", no_wrap=head not in long, overflow="fold")
        width = max(cell_len(line) for part in (head, *column) for line in str(part).split("\n"))
        needs += 3 + (min(width // 2 + 1, _PROSE) if head in long else width)
    for row in cells:
        table.add_row(*row)
    console = Console(width=None if sys.stdout.isatty() else max(needs, 160))
    if needs <= console.width:
        console.print(table)
        return
    console.print(title, style="italic")
    for row in cells:
        for head, cell in zip(heads, row):
            if cell.plain not in ("-", "–"):
                console.print(Text.assemble(f"{' '.join(head.split())}: ", cell), soft_wrap=True)
        console.print()


def print_table(summaries: list[tuple[str, dict[str, Any]]]) -> None:
    """Print the summaries of episodes as a table."""
    heads = ["scene", "policy", "outcome", "time", "driven", "shortest\nstatic\npath", "longer\nthan\nshortest"]
    heads += ["waits", "replans", "smallest\nclearance", "cycle ms\np50 / p99"]
    rows: list[Sequence[Cell]] = [
        (
            name,
            n["policy"],
            (n["outcome"], "green" if n["reached"] else "red"),
            _shown(n["time"], ".1f", " s"),
            _shown(n["length"], ".2f", " m"),
            _shown(n["shortest"] or None, ".2f", " m"),
            _shown(n["length_ratio"] and round(100 * (n["length_ratio"] - 1), 1) + 0.0, "+.1f", " %"),
            str(n["waits"]),
            str(n["replans"]),
            _shown(n["min_clearance"], "z.2f", " m"),
            f"{_shown(n['cycle_ms_p50'], '.2f')} / {_shown(n['cycle_ms_p99'], '.2f')}",
        )
        for name, n in summaries
    ]
    _print_cells("Robot among moving obstacles", heads, "scene policy outcome", rows, long=heads[-1:])


def print_decisions(decisions: list[dict[str, Any]]) -> None:
    """Print an episode's decisions as a table, with a row for each that differs from the one before."""
    heads = ("time", "action", "obstacle", "encounter", "closest", "weighed", "gap", "guard", "reason")
    rows: list[Sequence[Cell]] = []
    for one in decisions:
        closest = "-"
        if one["time_to_closest"] is not None:
            gap = one["distance_at_closest"]  # less than 0 where discs would overlap; reasons say 0 there as well
            closest = f"{_shown(gap and max(gap, 0.0), '.2f', ' m')} in {one['time_to_closest']:.1f} s"
        row = (
            f"{one['t']:.1f} s",
            one["action"],
            "-" if one["obstacle"] is None else str(one["obstacle"]),
            one["encounter"] or "-",
            closest,
            ", ".join(f"{name}: {cost}" for name, cost in one["weighed"]) or "-",
            _shown(one["gap"] and 100 * one["gap"], ".1f", " %"),
            one["guard"] or "-",
            one["reason"],
        )
        if not rows or row[1:] != rows[-1][1:]:
            rows.append(row)
    left = "action obstacle encounter closest weighed guard reason"
    _print_cells("Decisions, each until the next", heads, left, rows, long=("weighed", "reason"))


def print_summaries(table: Sequence[Summary]) -> None:
    """Print the results of policies on a suite as a table."""
    import textwrap

    from antway.arena.summary import MEANS, remarks, summary_cells

    rows = [{head: cell for head, cell in summary_cells(one).items() if head not in MEANS[1:]} for one in table]
    heads = ["\n".join(textwrap.wrap(head, 12)) for head in rows[0]]
    long = [head for head in heads if "(" in head or head == heads[-1]]
    _print_cells("Policies against the clairvoyant optimum", heads, "level policy", [[*row.values()] for row in rows], long)
    for remark in remarks(table):
        print(remark)


def print_rounds(numbers: dict[str, Any]) -> None:
    """Print the visits of an episode with stops, and their totals, from its summary."""
    rows: list[Sequence[Cell]] = []
    for n, visit in enumerate(numbers["visits"], 1):
        waits = visit["start"] - visit["arrival"]
        waited = f"{waits:.1f} s" if waits > 0 else "-"
        late = (f"{visit['late']:.1f} s", "red") if visit["late"] > 0 else "-"
        rows.append((str(n), visit["stop"], f"{visit['arrival']:.1f} s", waited, f"{visit['end']:.1f} s", late))
    if rows:
        _print_cells("Stops", ("visit", "stop", "arrives", "waits", "leaves", "late"), "stop", rows)
    late_in_all = f"{numbers['lateness']:.1f} s late in all" if numbers["lateness"] > 0 else "none late"
    print(f"{numbers['visited']} of {numbers['stops']} stops visited, {late_in_all}; orders decided on: {numbers['orders']}")


def print_tour(tour: TourPlan) -> None:
    """Print a tour as a table, with a row for each stop in the order of the visits, and its totals."""
    task, several = tour.task, len(tour.routes) > 1
    rows: list[Sequence[Cell]] = []
    for k, route in enumerate(tour.routes, 1):
        for n, stop in enumerate(route.order.tolist()):
            earliest, latest = task.windows[stop].tolist()
            window = f"from {earliest:g} s" if latest == float("inf") else f"{earliest:g} - {latest:g} s"
            late = max(0.0, float(route.arrival[n] + route.waiting[n]) - latest)
            row: list[Cell] = [
                str(k),
                str(n + 1),
                task.names[stop],
                f"{route.legs[n].length:.1f} m",
                f"{route.arrival[n]:.1f} s",
                f"{route.waiting[n]:.1f} s" if route.waiting[n] > 0 else "-",
                window if (earliest, latest) != (0, float("inf")) else "-",
                (f"{late:.1f} s", "red") if late > 1e-9 * (1 + tour.duration) else "-",
            ]
            rows.append(row if several else row[1:])
    heads = ["robot", "visit", "stop", "leg", "arrives", "waits", "window", "late"]
    _print_cells("Tour", heads if several else heads[1:], "stop", rows)
    collects = task.priorities is not None
    proof = ""
    if tour.feasible and tour.gap < 1e-6:
        proof = "; no tour collects more" if collects else "; proved the best"
    elif tour.feasible and tour.gap < 1.0:
        proof = f"; at most {100 * tour.gap:.1f} % " + ("more can be collected" if collects else "over the best")
    left = f"; left out: {', '.join(task.names[stop] for stop in tour.skipped)}" if tour.skipped else ""
    print(f"{tour.length:.1f} m, done after {tour.duration:.1f} s{proof}{left}")
    if not tour.feasible:
        print(f"not in time: {tour.lateness:.1f} s late in all")


def _shown(value: float | None, form: str, unit: str = "") -> str:
    """Return a number as text, or a dash for None and NaN, as for a policy that never arrived."""
    return "-" if value is None or value != value else f"{value:{form}}{unit}"


def exit_with(app: Callable[..., Any]) -> None:
    """Run the command line `app` and exit with its status; wrong input gives one line on stderr and status 2."""
    warnings.showwarning = lambda message, *_, **__: say(f"warning: {message}")
    usage_error: Any = typer.BadParameter.__base__
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by who started the command
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):  # letters that the locale lacks are printed as escapes
            stream.reconfigure(errors="backslashreplace")
    try:
        status = app(standalone_mode=False, prog_name="antway")  # "python -m antway" would be completed as Python is
        if status == INTERRUPTED:
            raise KeyboardInterrupt
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as error:
        if BrokenPipeError not in (type(error), type(error.__context__)):  # Typer exits after one by itself
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nobody reads what is still to be written
        status = UNREAD
    except (BadInput, Refused, OSError) as error:
        unnamed = isinstance(error, OSError) and error.errno == errno.ENOSPC and error.filename is None
        say(f"error: {f'stdout cannot be written: {os.strerror(errno.ENOSPC)}' if unnamed else error}")
        status = WRONG_INPUT
    except Fault as error:
        say(f"error: {error}")
        status = FAULT
    except usage_error as error:
        text = " ".join(error.format_message().split())
        hint = "; X,Y is written without a space, and a name with spaces in quotes" * ("extra argument" in text)
        say(f"error: {text}{hint}")
        status = WRONG_INPUT
    except (KeyboardInterrupt, typer.Abort):
        say("interrupted")
        status = INTERRUPTED
    sys.exit(status or 0)
