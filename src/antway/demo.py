"""The paper's experiment on the scenes that antway ships: episodes, figures, animations, replay pages, numbers."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from antway import checks
from antway.avoidance.routes import Routes
from antway.planning import Problem, solve
from antway.scenes import SCENES
from antway.scenes import scene as shipped_scene
from antway.verify import check_episode
from antway.world.episode import EpisodeResult, run
from antway.world.policy import Task
from antway.world.scenario import Scenario, load_scenario
from antway.world.trace import Trace

FLOW_CHARTS = ("figure1_ant_system.png", "figure2_improved_ant_system.png", "figure3_avoidance.png")


def scene(name: str) -> Scenario:
    """Return the shipped scene of that name, or the scenario in the file of that name, which may be a path.

    Raises
    ------
    BadScenario
        If there is neither.
    """
    return load_scenario(shipped_scene(name) if name in SCENES and not Path(name).exists() else name)


def summary(result: EpisodeResult, task: Task) -> dict[str, Any]:
    """Return the numbers of an episode as JSON values: times in s and ms, lengths in m; None where there is none.

    `shortest` is the length of the shortest way at any angle over the static map, `length_ratio` what the robot drove, and the
    rest to the goal's centre, over it; None unless the goal was reached.
    """
    shortest = static_shortest(task)
    rest = 0.0 if result.trace is None else math.dist(result.trace.xy[-1].tolist(), task.goal)
    ratio = (result.length + rest) / shortest if result.reached and shortest > 0 else math.nan
    return {
        "outcome": result.outcome.value,
        "reason": result.reason,
        "reached": result.reached,
        "time": round(result.time, 6),
        "length": round(result.length, 6),
        "shortest": _finite(shortest),
        "length_ratio": _finite(ratio),
        "waits": result.waits,
        "replans": result.replans,
        "min_clearance": _finite(result.min_clearance),
        "cycle_ms_p50": _finite(result.cycle(50)),
        "cycle_ms_p99": _finite(result.cycle(99)),
        "seed": result.seed,
    }


def explained(trace: Trace) -> list[dict[str, Any]]:
    """Return every decision of an episode as JSON values, each of which stands until the next; None where there is none.

    Times in s, `distance_at_closest` in m between the discs' edges, `gap` 0.01 for 1 %, costs of the alternatives in s.
    """
    return [
        {
            "t": round(float(trace.t[step]), 6),
            "action": one.action,
            "obstacle": one.obstacle,
            "encounter": one.encounter or None,
            "time_to_closest": _finite(one.time_to_closest),
            "distance_at_closest": _finite(one.distance_at_closest),
            "alternatives": {name: _finite(cost) for name, cost in one.alternatives},
            "gap": _finite(one.gap),
            "guard": one.guard or None,
            "reason": one.reason,
        }
        for step, one in trace.decisions
    ]


def static_shortest(task: Task) -> float:
    """Return the length in m of the shortest way at any angle over the free cells of the static map; infinite without one."""
    routes = Routes(task)
    start, goal = routes.cell(task.start), routes.cell(task.goal)
    if start is None or goal is None:
        return math.inf
    return solve(Problem(task.grid.inflate(task.robot.radius), start, goal), "anyangle").length


def write_episode(result: EpisodeResult, folder: Path, said: Callable[[str], None] = lambda what: None) -> dict[str, Any]:
    """Write figures 4 to 7, the animation, the replay page, the trace and the summary of an episode; return the summary."""
    from antway.view import figures
    from antway.view.animation import write_animation
    from antway.view.replay import write_replay

    trace = result.trace
    assert trace is not None, "the episode was run without a record"
    check_episode(result)
    folder.mkdir(parents=True, exist_ok=True)
    path = figures.shortest(trace.task)
    numbers = {"scenario": trace.scenario, "policy": trace.policy, **summary(result, trace.task)}
    trace.save(folder / "trace.json")
    (folder / "summary.json").write_text(json.dumps(numbers, indent=2) + "\n", encoding="utf-8")
    said("figures")
    meet, avoid = figures.moments(trace)
    ends = (trace.task.start, trace.task.goal)
    figures.save(figures.plan_figure(trace.task.grid, path, ends=ends), folder / "figure4_global_path.png")
    about = figures.moment_figure(trace, meet, title="About to meet a moving obstacle", path=path)
    figures.save(about, folder / "figure5_encounter.png")
    round_it = figures.moment_figure(trace, avoid, title=figures.title_of(trace.decision_at(avoid)), path=path, pheromone=True)
    figures.save(round_it, folder / "figure6_avoidance.png")
    figures.save(figures.final_figure(trace, path=path), folder / "figure7_final_path.png")
    said("animation")
    write_animation(trace, folder / "demo.gif", shortest=path)
    said("replay page")
    write_replay(trace, folder / "replay.html", shortest=path)
    return numbers


def run_demo(
    out: Path, *, policy: str = "antway", seed: int | None = None, said: Callable[[str, str], None] = lambda scene, what: None
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Play every scene and write what came of it under `out`; yield each scene's name and summary.

    The pictures of the paper's scene, and those that belong to no scene, lie in `out` itself; the rest in a folder a scene.
    `said(scene, what)` is called before each part.
    """
    out.mkdir(parents=True, exist_ok=True)
    for name in SCENES:
        said(name, "episode")
        result = run(scene(name), policy, seed=seed)
        yield name, write_episode(result, out / name, lambda what, name=name: said(name, what))  # type: ignore[misc]
    for picture in sorted((out / SCENES[0]).iterdir()):
        shutil.copyfile(picture, out / picture.name)
    said("paper", "flow charts")
    write_flow_charts(out)
    said("paper", "convergence")
    write_convergence(scene(SCENES[0]), out / "convergence.png")


def write_flow_charts(out: Path) -> None:
    """Write Figures 1 to 3."""
    from antway.view import diagrams
    from antway.view.figures import save

    charts = (diagrams.ant_system_chart, diagrams.improved_chart, diagrams.avoidance_chart)
    for name, draw in zip(FLOW_CHARTS, charts):
        save(draw(), out / name)


def write_convergence(scenario: Scenario, path: Path, *, seed: int = 0, cycles: int = 50) -> dict[str, float]:
    """Draw how the Ant System converges on a scene's map under each reading of the persistence; return the best lengths, m."""
    from antway.ants.gridpath import explore
    from antway.ants.persistence import Adaptive, Constant, Persistence, Printed
    from antway.view import figures

    checks.integer("cycles", cycles, low=1)
    task = scenario.task
    room = task.grid.inflate(task.robot.radius)
    problem = Problem(room, room.cell_at(task.start), room.cell_at(task.goal))
    readings: dict[str, Persistence] = {
        "constant 0.7": Constant(0.7),
        "adaptive, corrected": Adaptive(),
        "adaptive, as printed": Printed(),
    }
    found = {
        name: explore(problem, seed=seed, persistence=persistence, heuristic="goal", retreat=False, cycles=cycles)
        for name, persistence in readings.items()
    }
    histories = {name: exploration.history for name, exploration in found.items()}
    best = figures.shortest(task).length
    figures.save(figures.convergence_figure(histories, optimum=best), path)
    return {name: exploration.plan.length for name, exploration in found.items()}


def _finite(value: float) -> float | None:
    return round(float(value), 6) if math.isfinite(value) else None
