"""The command line. A command imports what it needs when it runs, so that `--help` stays quick.

Exit status: 0 done, 1 a policy that raised, or a fault of antway's own, 2 wrong input, 3 no path, 4 out of budget or time, or a
tour that is late, 5 contact in a run, 130 interrupted, 141 output that nobody reads. Answers go to stdout (with --json nothing
else does), progress and messages to stderr.
"""

from __future__ import annotations

import os
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Annotated

import typer

from antway import commands
from antway.console import (
    FAULT,
    Json,
    MapFile,
    MovesName,
    Resolution,
    Seed,
    episode_bar,
    exit_with,
    faults_named,
    name_option,
    number_option,
    pair,
    path_option,
    picture_option,
    print_decisions,
    print_json,
    print_rounds,
    print_summaries,
    print_table,
    say,
    scene_argument,
    status_of,
    working,
)
from antway.errors import BadParameter
from antway.tables import PLANNERS, POLICIES, ROBOTS, SHIPPED_SCENES, SUITES, WARM, names
from antway.writing import VIEWS, writing

app = typer.Typer(
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)


RunSeed = Annotated[int | None, number_option("seed", int, "N", "Seed of every random choice; the scenario's by default.")]
RobotName = Annotated[str | None, name_option(ROBOTS, f"Robot: {names(ROBOTS)}, or a .toml file.")]
SMALL = 2**19  # cells; up to this size, a search by interpreted kernels takes less time than compiling kernels
TINY = 2**16  # cells; up to this size, it takes less time than loading Numba and compiled kernels

_PARETO = (
    "Find every trade of time, distance and clearance from moving obstacles (up to 1 m), by ants; for coarse maps. "
    "Each move takes as long as the longest, a diagonal: 1.4 s a metre at 1 m/s."
)
ScenarioName = Annotated[str, scene_argument("SCENARIO", "A .toml file")]
PlannerName = Annotated[str, name_option(PLANNERS, f"Planner: {names(PLANNERS)}, or MODULE:NAME.")]
PolicyName = Annotated[
    str,
    name_option(
        POLICIES, f"Policy that steers the robot: {names(POLICIES)}, or MODULE:CLASS; /OPTION=VALUE after it sets an option."
    ),
]


@app.callback(invoke_without_command=True)
def top(context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    """Plan paths for robots, and drive them among moving obstacles.

    Exit status: 0 done, 1 a policy or planner raised an error, 2 wrong input, 3 no path, 4 time ran out, or a tour is late,
    5 contact, 130 interrupted, 141 nobody reads the output.
    """
    if version:
        from antway.version import __version__

        print(f"antway {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


@app.command("plan")
def plan_command(
    map_file: MapFile,
    start: Annotated[str, typer.Option(metavar="X,Y", help="Start in m (with --cells: ROW,COL).")],
    goal: Annotated[str, typer.Option(metavar="X,Y", help="Goal in m (with --cells: ROW,COL).")],
    cells: Annotated[bool, typer.Option("--cells", help="Start and goal are cells, ROW,COL.")] = False,
    planner: PlannerName = "jps",
    moves: MovesName = "eight",
    radius: Annotated[float, number_option("radius", float, "M", "The robot's radius in m.")] = 0.0,
    resolution: Resolution = None,
    seed: Seed = 0,
    time_limit: Annotated[float | None, number_option("time_limit", float, "S", "Stop after this many seconds.")] = None,
    pareto: Annotated[bool, typer.Option("--pareto", help=_PARETO)] = False,
    obstacles: Annotated[
        str | None, typer.Option(metavar="SCENARIO", help="With --pareto: the scenario whose obstacles move on the map.")
    ] = None,
    robot: RobotName = None,
    smooth: Annotated[bool, typer.Option("--smooth", help="With --robot: a motion within the robot's limits.")] = False,
    out: Annotated[Path | None, picture_option("the plan")] = None,
    json: Json = False,
) -> int:
    """Plan a path on a map.

    Exit status: 3 if there is no path, 4 if time ran out, 1 if a planner of your own raised an error.
    """
    from antway import Moves, Problem, check_plan, checks, load_map, solve
    from antway.planning import standing_cell
    from antway.warmup import small_problem

    ends = {name: pair(name, text, int if cells else float) for name, text in (("start", start), ("goal", goal))}
    rule = Moves(checks.choice("moves", moves, [m.value for m in Moves]))
    for name, value, plain in (("planner", planner, "jps"), ("time_limit", time_limit, None)):
        if pareto and value != plain:
            raise BadParameter(name, value, "left out with --pareto, which searches by ants for as long as they need")
    if smooth and (robot is None or pareto):
        raise BadParameter("smooth", True, "with --robot, which says what drives, and without --pareto")
    spec = None
    if robot is not None:
        from antway.world.robots import load_robot

        if radius != 0.0:
            raise BadParameter("radius", radius, "left out with --robot, which has its own")
        spec = load_robot(robot)
        radius = spec.radius
    with working("planning"):
        grid = load_map(map_file, resolution=resolution)
        if not smooth:
            _interpret_if_small(grid.blocked.size, planner)
        inflated = grid.inflate(radius)
        source, target = (end if cells else standing_cell(name, end, grid, inflated, radius) for name, end in ends.items())
        problem = Problem(inflated, source, target, rule)
    if pareto:
        return commands.plan_front(problem, grid, radius, None if spec is None else spec.v_max, obstacles, seed, out, json)
    if obstacles is not None:
        raise BadParameter("obstacles", obstacles, "left out without --pareto")
    # Here and below: what planners and policies print does not belong to the answer on stdout.
    with working("planning"), faults_named(planner), redirect_stdout(sys.stderr):
        if planner in PLANNERS:  # kernels are loaded, and compiled once on a machine, before the clock of the search starts
            solve(small_problem(rule), planner)
        path = solve(problem, planner, seed=seed, time_limit=time_limit)
        check_plan(problem, path)
    if smooth and spec is not None and len(path.cells):
        return commands.smooth_plan(path, grid, spec, seed, out, json)
    return commands.print_plan(path, grid, problem, planner, out, json)


def _interpret_if_small(cells: int, planner: str) -> None:
    """Let Python interpret the kernels if that is faster than compiling them or loading Numba.

    Interpreted and compiled kernels give the same answers (tests/test_without_jit.py). NUMBA_DISABLE_JIT=0 forces compilation.
    """
    if cells > SMALL or planner not in ("jps", "astar") or "numba" in sys.modules or "NUMBA_DISABLE_JIT" in os.environ:
        return
    from antway.kernels.base.cache import is_compiled

    if cells <= TINY or not is_compiled("search", "astar.solve"):
        os.environ["NUMBA_DISABLE_JIT"] = "1"
        import numpy as np

        np.seterr(over="ignore")  # unsigned integers overflow, as in compiled kernels


def _parts(text: str) -> list[str]:
    """Return the parts of a list with commas, without the spaces around them."""
    return [part.strip() for part in text.split(",")]


@app.command("run")
def run_command(
    scenario: ScenarioName,
    policy: PolicyName = "antway",
    seed: RunSeed = None,
    out: Annotated[Path | None, path_option("out", "DIR", "Write figures, a replay page, the trace and more.")] = None,
    explain: Annotated[bool, typer.Option("--explain", help="Print the decisions, what was weighed, and why.")] = False,
    robot: RobotName = None,
    json: Json = False,
) -> int:
    """Drive a robot through a scenario.

    Column "longer than shortest": the length driven and what is left to the goal's centre, against the shortest path.

    Exit status: 5 on a contact, 4 if time ran out, 1 if the policy raised an error.
    """
    from antway import check_episode, load_scenario, run
    from antway.demo import explained, summary, write_episode
    from antway.warmup import compiling_beside

    with working("running"), compiling_beside(policy):
        place = load_scenario(scenario)
        if robot is not None:
            from antway.world.robots import load_robot

            place = place.driven_by(load_robot(robot))
        with redirect_stdout(sys.stderr):
            result = run(place, policy, seed=seed)
        if out is not None:
            numbers = write_episode(result, out)
        else:
            check_episode(result)
            numbers = {"scenario": place.name, "policy": policy, **summary(result, place.task)}
    decisions = explained(result.trace) if explain and result.trace is not None else None
    if json:
        print_json(numbers if decisions is None else {**numbers, "decisions": decisions})
    else:
        if decisions is not None:
            print_decisions(decisions)
        print_table([(place.name, numbers)])
        if "visits" in numbers:
            print_rounds(numbers)
        print(f"{numbers['outcome']}: {numbers['reason']}")
        if out is not None:
            print(f"written to {out}")
    return status_of([numbers["outcome"]])


@app.command("demo")
def demo_command(
    out: Annotated[Path, path_option("out", "DIR", "Folder to write to.")] = Path("demo"),
    policies: Annotated[
        str, typer.Option("--policies", "--policy", metavar="A,B", help="Shown side by side; figures show the last one.")
    ] = "paper,antway",
    seed: RunSeed = None,
    json: Json = False,
) -> int:
    """Play the shipped scenes; write figures, animations and replay pages."""
    from rich.console import Console
    from rich.markup import escape

    from antway.demo import run_demo
    from antway.warmup import compiling_beside

    console, shown = Console(stderr=True), _parts(policies)
    with console.status("starting") as status, working("playing the scenes"), compiling_beside(shown[-1]):

        def progress(name: str, what: str) -> None:
            status.update(escape(f"{name}: {what}"))

        with redirect_stdout(sys.stderr):
            rows = list(run_demo(out, policies=shown, seed=seed, on_progress=progress))
    rows.sort(key=lambda row: SHIPPED_SCENES.index(row[0]))
    if json:
        print_json({"episodes": [numbers for _, numbers in rows], "out": str(out)})
    else:
        print_table(rows)
        print(f"pictures in {out}; open {out / 'replay.html'} in a browser to play the episodes")
    return status_of(numbers["outcome"] for _, numbers in rows)


@app.command("bench")
def bench_command(
    context: typer.Context,
    suite: Annotated[
        str,
        typer.Argument(
            metavar="SUITE", help=f"One of {names(SUITES)}; or predict (forecasts on a recording), or ants (what ants add)."
        ),
    ],
    file: Annotated[Path | None, typer.Argument(metavar="FILE", help="With predict: a recording, as for tracks:FILE.")] = None,
    policies: Annotated[
        str,
        typer.Option(
            "--policies", "--policy", metavar="A,B", help="Policies, or MODULE:CLASS; /OPTION=VALUE after one sets an option."
        ),
    ] = "antway,oracle",
    robot: RobotName = None,
    episodes: Annotated[int | None, number_option("episodes", int, "N", "Episodes to play of each group of the suite.")] = None,
    engine: Annotated[str, typer.Option(metavar="NAME", help="What runs the episodes: local or ray.")] = "local",
    workers: Annotated[int | None, number_option("workers", int, "N", "Processes; one per core by default.")] = None,
    timeout: Annotated[float, number_option("timeout", float, "S", "Give up an episode after this many seconds.")] = 120.0,
    out: Annotated[
        Path, path_option("out", "DIR", "Folder for results, report and tables; an earlier run there continues.")
    ] = Path("bench"),
    tables: Annotated[str, typer.Option("--export", metavar="A,B", help="Tables to write: csv, json, parquet.")] = "csv,json",
    json: Json = False,
) -> int:
    """Compare policies on a suite of worlds.

    They are measured against an optimum that knows the future. A run that was stopped continues where it was.

    Exit status: 1 if a policy raised an error in all episodes, or in all of a level.
    """
    from dataclasses import asdict
    from importlib.util import find_spec

    if suite == "predict":
        commands.refuse_unused(context, "suite", "file", "json")
    if suite == "predict" or file is not None:
        return commands.predict(suite, file, json)
    if suite == "ants":
        commands.refuse_unused(context, "suite", "episodes", "out", "json")
        return commands.compare_ants(10 if episodes is None else episodes, out, json)
    from antway import checks
    from antway.arena import engines
    from antway.arena.causes import errors
    from antway.arena.store import EXPORTS, Results, export
    from antway.arena.suites import episodes as episodes_of
    from antway.arena.summary import markdown, sections, summarise
    from antway.view.report import write_report
    from antway.world.robots import load_robot

    names, kinds = _parts(policies), [checks.choice("export", kind, EXPORTS) for kind in _parts(tables)]
    if "parquet" in kinds and find_spec("pyarrow") is None:
        raise BadParameter("export", tables, "csv and json, or install pyarrow (the extra `arena`)")
    cores = os.cpu_count() or 1 if workers is None else workers
    engines.check_engine(engine, cores, timeout)
    if robot == "":
        load_robot(robot)  # which refuses it, although it stands for the suite's own robot in `episodes`
    with working("preparing"), redirect_stdout(sys.stderr):
        jobs = engines.table_jobs(episodes_of(suite, episodes, robot or ""), names)
    with writing("out", out):
        out.mkdir(parents=True, exist_ok=True)
    with Results(out / "results.db") as results:
        with episode_bar(jobs[0].episode.suite, len(jobs)) as advance:
            engines.bench(jobs, results, engine=engine, workers=cores, timeout=timeout, done=lambda row: advance())
        every = results.rows()
        known = {row.key for row in every}
        wanted = {key for job in jobs if (key := job.key) in known}
        rows = [row for row in every if row.key in wanted]
        with working("writing the report"), writing("out", out):
            for kind in kinds:
                export(every, out / f"results.{kind}")
            text = "\n".join(f"## {name}\n\n{markdown(played)}" for name, played in sorted(sections(every).items()))
            (out / "summary.md").write_text(text, encoding="utf-8")
            write_report(results, out / "report.html")
    table = summarise(rows, list(dict.fromkeys(job.key[2] for job in jobs[: len(names)])))
    if json:
        print_json({"suite": jobs[0].episode.suite, "summaries": [asdict(one) for one in table], "out": str(out)})
    else:
        print_summaries(table)
        print(f"results, tables and report in {out}")
    for line in errors(rows):
        say(line)
    return FAULT if any(one.outcomes["error"] == one.episodes for one in table) else 0


@app.command("warmup")
def warmup_command(
    kinds: Annotated[
        list[str] | None, typer.Argument(metavar="KIND", help=f"What to prepare: {names(WARM)}; all by default.")
    ] = None,
    workers: Annotated[int | None, number_option("workers", int, "N", "Processes; one per core by default.")] = None,
) -> int:
    """Compile all kernels now, on all cores, and keep them on disk."""
    import time

    from antway.kernels.base.cache import cache_folder
    from antway.warmup import warm_up

    started = time.perf_counter()
    for what, seconds in warm_up(kinds or WARM, workers=os.cpu_count() or 1 if workers is None else workers):
        say(f"{what}: {seconds:.1f} s")
    folder = cache_folder() or os.environ.get("NUMBA_CACHE_DIR") or "the folders __pycache__"
    print(f"ready after {time.perf_counter() - started:.0f} s; kernels in {folder}")
    return 0


@app.command("view")
def view_command(
    trace_file: Annotated[Path, typer.Argument(metavar="TRACE", help="A trace.json that run or demo wrote.")],
    out: Annotated[Path, path_option("out", "FILE", "File to write: .html, .gif, .mp4, .png, .svg or .pdf.", VIEWS)],
    at: Annotated[
        float | None, number_option("at", float, "S", "For a picture: show this moment, in s, in place of the whole path.")
    ] = None,
) -> int:
    """Turn a trace into a replay page, an animation or a picture."""
    from antway.view import write_view

    with working("drawing"):
        write_view(trace_file, out, at=at)
    print(f"written to {out}")
    return 0


@app.command("serve")
def serve_command(
    port: Annotated[int, number_option("port", int, "N", "Port; 0 takes any free one.")] = 8765,
    host: Annotated[
        str, typer.Option(metavar="HOST", help="Address of this machine at which others may open the page (with a token).")
    ] = "127.0.0.1",
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> int:
    """Serve the live page: draw a map, drop obstacles, watch policies at work; Ctrl-C ends it."""
    import importlib.util
    import webbrowser
    from contextlib import suppress

    missing = [name for name in ("starlette", "uvicorn", "httptools", "websockets") if importlib.util.find_spec(name) is None]
    if missing:
        raise BadParameter("extra web", "not installed", f"installed: pip install {' '.join(missing)}")
    from antway.web.server import serve

    def ready(url: str) -> None:
        print(f"antway at {url} (Ctrl-C ends it)", flush=True)
        if browser:
            webbrowser.open(url)

    with suppress(KeyboardInterrupt):
        serve(host, port, ready=ready)
    return 0


@app.command("ros2", context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def ros2_command(context: typer.Context) -> int:
    """Run the ROS 2 node.

    All arguments go to ROS: --ros-args -p robot.name:=turtlebot4 -r odom:=/odometry/filtered.
    """
    from importlib.util import find_spec

    if find_spec("rclpy") is None:
        raise BadParameter("rclpy", None, "importable: source the robot's ROS 2 first, and install antway beside it")
    from antway.ros2.node import main as spin

    return spin(["antway", *context.args])


app.command("tour")(commands.tour_command)
app.command("tsp")(commands.tsp_command)
app.command("tsptw")(commands.tsptw_command)
for _command in app.registered_commands:  # the list of commands wraps these lines instead of cutting them off
    _command.short_help = (_command.callback.__doc__ or "").partition("\n")[0] if _command.callback else ""


def main() -> None:
    """Run the command line and exit with its status."""
    sys.path.append(os.getcwd())  # MODULE:NAME is looked up here last, so that local files hide no installed modules
    exit_with(app)
