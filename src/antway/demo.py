"""The paper's experiment on the shipped scenes: episodes, figures, animations, replay pages, numbers."""

from __future__ import annotations

import json
import math
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import redirect_stdout
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from antway.errors import BadParameter
from antway.planning import Problem, solve
from antway.processes import pool
from antway.scenes import ROUNDS, SCENES
from antway.verify_episode import check_episode
from antway.view.pages import rounded
from antway.world.episode import EpisodeResult, run
from antway.world.line_of_sight import diagonal_radius, nearest_free
from antway.world.policy import Task, make_policy
from antway.world.scenario import Scenario, load_scenario
from antway.world.trace import Trace
from antway.writing import writing

TIMINGS = ("cycle_ms_p50", "cycle_ms_p99", "order_ms_max")  # entries of a summary that differ between equal runs
FLOW_CHARTS = ("figure1_ant_system.png", "figure2_improved_ant_system.png", "figure3_avoidance.png")


def summary(result: EpisodeResult, task: Task) -> dict[str, Any]:
    """Return the numbers of an episode as JSON values: times in s and ms, lengths in m; None for missing ones.

    `shortest` is the length of the shortest path at any angle on the static map, in rounds through the visited stops.
    `length_ratio` is the driven length plus the rest to the goal's centre, divided by it; None unless the goal was reached, or
    where no path leads from cell to cell.
    """
    rounds = result.rounds
    via = () if rounds is None else tuple(rounds.stops[visit.stop].at for visit in rounds.visits)
    ends = [task.start, *via, task.goal]
    shortest = math.fsum(static_shortest(replace(task, start=a, goal=b)) for a, b in pairwise(ends))
    rest = 0.0 if result.trace is None else math.dist(result.trace.xy[-1].tolist(), task.goal)
    ratio = (result.length + rest) / shortest if result.reached and 0 < shortest < math.inf else math.nan
    numbers: dict[str, Any] = {
        "outcome": result.outcome.value,
        "reason": result.reason,
        "reached": result.reached,
        "time": round(result.time, 6),
        "length": round(result.length, 6),
        "shortest": rounded(shortest),
        "length_ratio": rounded(ratio),
        "waits": result.waits,
        "replans": result.replans,
        "min_clearance": rounded(result.min_clearance),
        "cycle_ms_p50": rounded(result.cycle(50)),
        "cycle_ms_p99": rounded(result.cycle(99)),
        "seed": result.seed,
    }
    if rounds is not None:
        late = [rounds.lateness(visit) for visit in rounds.visits]
        numbers |= {
            "stops": len(rounds.stops),
            "visited": len(rounds.visits),
            "lateness": round(math.fsum(late), 6),
            "orders": len(rounds.turns),
            "order_ms_max": rounded(float(result.order_ms.max(initial=0.0))),
            "visits": [{**v._asdict(), "stop": rounds.name(v.stop), "late": s} for v, s in zip(rounds.visits, late)],
        }
    return numbers


def explained(trace: Trace) -> list[dict[str, Any]]:
    """Return all decisions of an episode as JSON values; each is valid until the next. Missing values are None.

    Times are in s, `distance_at_closest` in m between the discs' edges, `gap` 0.01 is 1 %, and costs of alternatives are in s;
    `weighed` has them in words.
    """
    return [
        {
            "t": round(float(trace.t[step]), 6),
            "action": one.action,
            "obstacle": one.obstacle,
            "encounter": one.encounter or None,
            "time_to_closest": rounded(one.time_to_closest),
            "distance_at_closest": rounded(one.distance_at_closest),
            "alternatives": {name: rounded(cost) for name, cost in one.alternatives},
            "weighed": one.weighed(),
            "gap": rounded(one.gap),
            "guard": one.guard or None,
            "reason": one.reason,
        }
        for step, one in trace.decisions
    ]


def static_shortest(task: Task) -> float:
    """Return the length in m of the shortest path at any angle over the free cells of the static map; infinite without one."""
    inflated, radius = task.grid.inflate(diagonal_radius(task)), task.robot.radius
    start, goal = (nearest_free(task.grid, inflated, xy, 3, radius) for xy in (task.start, task.goal))
    if start is None or goal is None:
        return math.inf
    return solve(Problem(task.grid.inflate(radius), start, goal), "anyangle").length


def write_episode(result: EpisodeResult, folder: Path, *, beside: Sequence[EpisodeResult] = ()) -> dict[str, Any]:
    """Write figures, animation, replay page, trace, summary and timings of an episode; return the summary.

    Episodes `beside` it, of the same scene, have their own figures and are shown to its left in the animation and the page.
    """
    from antway.view import figures
    from antway.view.animation import write_animation
    from antway.view.replay import write_replay

    numbers = write_record(result, folder)
    trace, others = _trace(result), [_trace(other) for other in beside]
    for one in (*others, trace):
        write_figures(one, folder)
    first, *rest = (*others, trace)
    path = figures.global_path(trace)
    write_animation(first, folder / "demo.gif", beside=rest, shortest=path, width=360 if rest else 480)
    write_replay(first, folder / "replay.html", beside=rest, shortest=path)
    return numbers


def figure_names(policy: str) -> tuple[str, ...]:
    """Return the file names of a policy's four figures: the paper's Figs. 4 to 7 for policy `paper`, else other names."""
    parts = ("global_path", "encounter", "avoidance", "final_path")
    if policy == "paper":
        return tuple(f"figure{n}_{part}.png" for n, part in enumerate(parts, 4))
    return tuple(f"{re.sub(r'[^A-Za-z0-9-]+', '_', policy)}_{part}.png" for part in parts)


def write_figures(trace: Trace, folder: Path) -> None:
    """Write pictures of the initial path, an encounter before and during avoidance, and the driven path."""
    from antway.view import figures

    path, (meet, avoid) = figures.global_path(trace), figures.moments(trace)
    if trace.policy == "paper":
        ends, title = (trace.task.start, trace.task.goal), "Global shortest path, by Dijkstra's algorithm"
        first = figures.plan_figure(trace.task.grid, figures.shortest(trace.task), ends=ends, title=title)
    else:
        first = figures.moment_figure(trace, 0, title=f"Policy {trace.policy} sets out", path=path, pheromone=True)
    before, comes = trace.decision_at(meet), len(trace.obstacle_id) > 0
    meets = "About to encounter an obstacle" if before is not None and before.obstacle is not None else "No obstacle in the way"
    reacts = figures.title_of(trace.decision_at(avoid)) if comes else meets
    drawn = (
        first,
        figures.moment_figure(trace, meet, title=meets, caption=figures.meeting(before), path=path),
        figures.moment_figure(trace, avoid, title=reacts, path=path, pheromone=True),
        figures.final_figure(trace, path=path),
    )
    for picture, name in zip(drawn, figure_names(trace.policy)):
        figures.save(picture, folder / name)


def write_rounds(name: str, policy: str, seed: int | None, folder: Path) -> dict[str, Any]:
    """Play a scene with stops; write its figure, replay page, trace and summary, and return the summary."""
    from antway.view.replay import write_replay

    with redirect_stdout(sys.stderr):
        result = run(load_scenario(name), policy, seed=seed)
    numbers = write_record(result, folder)
    write_replay(_trace(result), folder / "replay.html")
    return numbers


def write_record(result: EpisodeResult, folder: Path) -> dict[str, Any]:
    """Check an episode, write its trace, summary, timings and rounds into `folder`, and return the summary with timings.

    Timings are only in `timings.json`, so that the other files are the same for the same seed.
    """
    trace = _trace(result)
    check_episode(result)
    numbers = {"scenario": trace.scenario, "policy": trace.policy, **summary(result, trace.task)}
    timings: dict[str, Any] = {name: numbers[name] for name in TIMINGS if name in numbers}
    timings |= {"cycle_ms": result.cycle_ms.tolist(), "order_ms": result.order_ms.tolist()}
    with writing("out", folder):
        folder.mkdir(parents=True, exist_ok=True)
        trace.save(folder / "trace.json")
        _write_json(folder / "summary.json", {name: value for name, value in numbers.items() if name not in TIMINGS})
        _write_json(folder / "timings.json", timings)
    if trace.rounds is not None:
        from antway.view.style import save
        from antway.view.tours import rounds_figure

        save(rounds_figure(trace), folder / "rounds.png")
    return numbers


def _write_json(path: Path, record: dict[str, Any]) -> None:
    path.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def run_demo(
    out: Path,
    *,
    policies: Sequence[str] = ("paper", "antway"),
    seed: int | None = None,
    on_progress: Callable[[str, str], None] = lambda scene, what: None,
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Play every scene with each policy and write the results under `out`; yield the scene and summary of each episode.

    The scene with stops, `rounds`, is played only with the last policy.

    The folder of a scene contains the figures of all policies, trace and summary of the last policy, an animation and a page
    with all policies side by side, and a folder with trace and summary for each other policy. Figures 4 to 7 are of policy
    `paper`. Pictures of the paper's scene, and those of no scene, are in `out` itself. `on_progress(scene, what)` is called
    before each part. Other processes play the other policies and draw, so a script that calls this must guard its own code by
    `if __name__ == "__main__"`.

    Raises
    ------
    BadParameter
        For an unknown policy, or none, and if `out` cannot be written to.
    """
    for name in policies:
        make_policy(name)
    if not policies:
        raise BadParameter("policies", policies, "at least one name")
    *others, shown = policies
    with writing("out", out):
        out.mkdir(parents=True, exist_ok=True)
    with pool(2) as workers:
        aside = workers.submit(_play, others, seed)  # in one process, since several would compile the same kernels
        drawn: dict[str, Future[dict[str, Any]]] = {}
        rounds: dict[str, Future[dict[str, Any]]] = {}
        for name in SCENES:
            on_progress(name, "episodes")
            played = run(load_scenario(name), shown, seed=seed)
            if not rounds:  # not earlier, because the first episode and the rounds would compile the same kernels
                rounds = {other: workers.submit(write_rounds, other, shown, seed, out / other) for other in ROUNDS}
            beside = [aside.result()[name, other] for other in others]
            drawn[name] = workers.submit(write_episode, played, out / name, beside=beside)
            for other, result in zip(others, beside):
                yield name, write_record(result, out / name / other)
        charts = workers.submit(write_flow_charts, out)
        on_progress(SCENES[0], "convergence")
        write_convergence(load_scenario(SCENES[0]), out / "convergence.png")
        for name in SCENES:
            on_progress(name, "figures, animation, replay page")
            yield name, drawn[name].result()
        for name in ROUNDS:
            on_progress(name, "rounds")
            yield name, rounds[name].result()
        charts.result()
    for picture in sorted(path for path in (out / SCENES[0]).iterdir() if path.is_file()):
        shutil.copyfile(picture, out / picture.name)


def _play(policies: Sequence[str], seed: int | None) -> dict[tuple[str, str], EpisodeResult]:
    """Play every scene with each policy."""
    with redirect_stdout(sys.stderr):  # stdout is for the answer of the command line
        return {(name, policy): run(load_scenario(name), policy, seed=seed) for policy in policies for name in SCENES}


def _trace(result: EpisodeResult) -> Trace:
    assert result.trace is not None, "the episode was run without a record"
    return result.trace


def write_flow_charts(out: Path) -> None:
    """Write Figures 1 to 3."""
    from antway.view import diagrams
    from antway.view.figures import save

    charts = (diagrams.ant_system_chart, diagrams.improved_chart, diagrams.avoidance_chart)
    for name, draw in zip(FLOW_CHARTS, charts):
        save(draw(), out / name)


def write_convergence(scenario: Scenario, path: Path) -> dict[str, float]:
    """Draw how the Ant System converges on a scene's map under each reading of the persistence; return the best lengths, m."""
    from antway.ants.gridpath import explore
    from antway.ants.persistence import Adaptive, Constant, Persistence, Printed
    from antway.view import figures

    task = scenario.task
    inflated = task.grid.inflate(task.robot.radius)
    problem = Problem(inflated, inflated.cell_at(task.start), inflated.cell_at(task.goal))
    readings: dict[str, Persistence] = {
        "constant 0.7": Constant(0.7),
        "adaptive, corrected": Adaptive(),
        "adaptive, as printed": Printed(),
    }
    found = {
        name: explore(problem, persistence=persistence, heuristic="goal", retreat=False)
        for name, persistence in readings.items()
    }
    histories = {name: exploration.history for name, exploration in found.items()}
    best = figures.shortest(task).length
    figures.save(figures.convergence_figure(histories, optimum=best), path)
    return {name: exploration.plan.length for name, exploration in found.items()}
