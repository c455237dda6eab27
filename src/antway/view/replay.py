"""The replay page: one HTML file that plays an episode in any browser, without a server and without the network."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from antway.arena.metrics import gaps
from antway.grid import Grid
from antway.planning import Plan
from antway.view.pages import asset, bits_to_base64, digest, embedded, faint_scale, filled, png_url, rounded, to_base64
from antway.world.policy import Decision
from antway.world.stops import Rounds
from antway.world.trace import Trace
from antway.writing import writing

_SCRIPTS = ("common.js", "layers.js", "canvas.js", "replay.js")
_IMPORT = re.compile(r"^import .*?;\n", re.MULTILINE)
_EXPORT = re.compile(r"^export \{.*?\};\n", re.MULTILINE)


def write_replay(trace: Trace, path: str | Path, *, beside: Sequence[Trace] = (), shortest: Plan | None = None) -> Path:
    """Write the page that plays `trace`, with the global path `shortest` as a layer; return its path."""
    with writing("out", path) as file:
        file.write_text(replay_page(trace, beside=beside, shortest=shortest), encoding="utf-8")
    return file


def replay_page(trace: Trace, *, beside: Sequence[Trace] = (), shortest: Plan | None = None) -> str:
    """Return the page as text; episodes `beside` it, of the same scene, play to its right at the same times.

    Names and reasons from the trace are only JSON data, which the script shows as text. The page's security policy allows only
    its own script and style, by their hashes.
    """
    style = asset("replay.css")
    script = "".join(_EXPORT.sub("", _IMPORT.sub("", asset(name))) for name in _SCRIPTS)
    policy = (
        f"default-src 'none'; script-src '{digest(script)}'; style-src '{digest(style)}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
    record = _record(trace, shortest)
    if beside:
        record["beside"] = [_record(other, shortest) for other in beside]
    data = json.dumps(record, allow_nan=False, separators=(",", ":"))
    parts = {
        "policy": policy,
        "title": html.escape(f"{trace.scenario} - {trace.policy} - antway"),
        "style": style,
        "data": embedded(data),
        "script": script,
    }
    return filled(asset("replay.html"), parts)


def _record(trace: Trace, shortest: Plan | None) -> dict[str, Any]:
    """Return the data for the page's script; places are quantised to 1/65535 of their bounding box, obstacles of their own."""
    task, grid = trace.task, trace.task.grid
    paths = [decision.path.xy for _, decision in trace.decisions if decision.path is not None]
    path = shortest.xy(grid) if shortest is not None and len(shortest.cells) else np.empty((0, 2))
    box, obstacles = _Box([trace.xy, path, *paths]), trace.obstacle_xy.reshape(-1, 2)
    far = _Box([obstacles]) if len(obstacles) else box  # obstacles may go far beyond the map
    masks: dict[bytes, int] = {}
    heaps: list[dict[str, Any]] = []
    decisions = [_decision(step, decision, box, masks, heaps) for step, decision in trace.decisions]
    return {
        "scenario": trace.scenario,
        "policy": trace.policy,
        "seed": str(trace.seed),
        "outcome": trace.outcome.value,
        "reason": trace.reason,
        "map": map_record(grid, lambda mask: _mask(mask, levels=1)),
        "box": box.record(),
        "t": to_base64(trace.t, "<f4"),
        "driven": to_base64(np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(trace.xy, axis=0).T)))), "<f4"),
        "speed": to_base64(np.hypot(*trace.velocity.T), "<f4"),
        "clearance": to_base64(gaps(trace).min(axis=1, initial=np.inf), "<f4"),
        "robot": {
            "xy": box.pack(trace.xy),
            "heading": to_base64(trace.heading, "<f4"),
            "radius": task.robot.radius,
            "range": rounded(task.robot.sensor_range),
            "occlusion": bool(trace.config.get("sensor", {}).get("occlusion", True)),
        },
        "start": list(task.start),
        "goal": list(task.goal),
        "tolerance": task.goal_tolerance,
        "stops": _stops(trace.rounds),
        "obstacles": {
            "id": [int(i) for i in trace.obstacle_id],
            "radius": [round(float(r), 6) for r in trace.obstacle_radius],
            "box": far.record(),
            "xy": far.pack(obstacles),
            "sensed": bits_to_base64(trace.sensed),
        },
        "global": box.pack(path) if len(path) else None,
        "decisions": decisions,
        "pheromone": heaps,
    }


def _stops(rounds: Rounds | None) -> list[dict[str, Any]]:
    """Return the stops of an episode in the order of the visits, then those not visited."""
    if rounds is None:
        return []
    visits = {visit.stop: visit for visit in rounds.visits}
    return [
        {
            "at": list(rounds.stops[stop].at),
            "name": rounds.name(stop),
            "end": visits[stop].end if stop in visits else None,
            "late": stop in visits and rounds.lateness(visits[stop]) > 0,
        }
        for stop in (*visits, *rounds.missed)
    ]


def map_record(grid: Grid, pack: Callable[[NDArray[np.bool_]], str]) -> dict[str, Any]:
    """Return the data of a map for the pages' scripts, with masks packed by `pack`; unknown cells are not shown as blocked."""
    return {
        "rows": grid.shape[0],
        "cols": grid.shape[1],
        "resolution": grid.resolution,
        "x": grid.origin[0],
        "y": grid.origin[1],
        "top_first": grid.top_first,
        "blocked": pack(grid.blocked if grid.unknown is None else grid.blocked & ~grid.unknown),
        "unknown": None if grid.unknown is None else pack(grid.unknown),
    }


def _decision(step: int, decision: Decision, box: _Box, masks: dict[bytes, int], heaps: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the data of a decision; equal pheromone is stored once."""
    heap, predicted = None, decision.predicted
    if decision.pheromone is not None:
        row, col, amount = decision.pheromone
        key = bytes(f"{row},{col},", "ascii") + np.ascontiguousarray(amount).tobytes()
        if key not in masks:
            masks[key] = len(heaps)
            (height, width), shades = amount.shape, np.round(15 * faint_scale(amount))
            heaps.append({"row": row, "col": col, "height": height, "width": width, "mask": _mask(shades, levels=15)})
        heap = masks[key]
    closest = (rounded(decision.time_to_closest), rounded(decision.distance_at_closest))
    record = {
        "step": step,
        "action": decision.action,
        "reason": decision.reason,
        "obstacle": None if decision.obstacle is None else int(decision.obstacle),
        "encounter": decision.encounter,
        "closest": None if None in closest else closest,
        "target": None if decision.local_target is None else [float(v) for v in decision.local_target],
        "path": None if decision.path is None else box.pack(decision.path.xy),
        "alternatives": decision.weighed(),
        "gap": rounded(decision.gap),
        "guard": decision.guard,
        "pheromone": heap,
        "predicted": None if predicted is None or not len(predicted) else to_base64(predicted, "<f4"),
    }
    return {key: value for key, value in record.items() if value not in (None, "", [])}


class _Box:
    """The bounding box of all points, in which points are quantised."""

    def __init__(self, points: list[NDArray[np.float64]]) -> None:
        every = np.vstack(points)
        low, high = every.min(axis=0), every.max(axis=0)
        self.low: list[float] = low.tolist()
        self.size: list[float] = np.maximum(high - low, 1e-9).tolist()

    def record(self) -> dict[str, float]:
        return {"x": self.low[0], "y": self.low[1], "width": self.size[0], "height": self.size[1]}

    def pack(self, points: NDArray[np.float64]) -> str:
        return to_base64(np.round((points - self.low) / self.size * 65535), "<u2")


def _mask(amount: NDArray[Any], *, levels: int) -> str:
    """Return integers in [0, levels] as a PNG with them as alpha; its first row is the last of `amount`."""
    picture = Image.fromarray(np.flipud(amount).astype(np.uint8))
    picture.putpalette([0, 0, 0] * (levels + 1))
    alpha = bytes(round(215 * k / levels) if levels > 1 else 255 * k for k in range(levels + 1))
    return png_url(picture, bits=1 if levels == 1 else 4, transparency=alpha)
