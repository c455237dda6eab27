"""The report: one HTML page of tables, plots and failures, made from the results file alone."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
import re
import tempfile
from collections.abc import Callable, Iterable, Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np

from antway.arena import metrics
from antway.arena.store import Results, Row
from antway.arena.summary import Summary, levels, paired, remarks, summarise
from antway.world.trace import Trace

GALLERY = 8  # failures shown for each policy
COLOURS = 8  # number of colours in report.css; the next eight policies have the same ones, dashed
WIDTH, HEIGHT, LEFT, BOTTOM = 460, 280, 52, 44  # size and margins of a plot, in pixels
_DATA = re.compile(r'(<script type="application/json" id="episode">)(.*?)(</script>)', re.DOTALL)
Point = tuple[float, float]


def write_report(results: Results, path: str | Path, replay: Callable[[Trace], str]) -> Path:
    """Write the report on everything in `results`; return its path.

    Parameters
    ----------
    results : Results
    path : str or Path
    replay : function of Trace
        Function that returns the page which plays an episode (`antway.view.replay.replay_page`).
    """
    path = Path(path)
    path.write_text(report_page(results, replay), encoding="utf-8")
    return path


def report_page(results: Results, replay: Callable[[Trace], str]) -> str:
    """Return the page as text; it opens offline, and its security policy allows its own scripts only."""
    rows = results.rows()
    replays = _Replays(results, replay)
    suites = list(dict.fromkeys(row.suite for row in rows))
    body = "".join(_suite(suite, [row for row in rows if row.suite == suite], replays) for suite in suites)
    style, script = _asset("report.css"), _asset("report.js")
    hashes = {"script": [_hash(script)], "style": [_hash(style)]}
    for kind, found in re.findall(r"(script|style)-src '(sha256-[^']+)'", replays.shell):
        hashes[kind].append(found)  # a replay opened from this page must satisfy this page's policy as well
    allowed = "; ".join(f"{kind}-src {' '.join(map(repr, values))}" for kind, values in hashes.items())
    versions = ", ".join(sorted({row.version for row in rows}))
    parts = {
        "policy": f"default-src 'none'; {allowed}; img-src data: blob:; base-uri 'none'; form-action 'none'",
        "style": style,
        "script": script,
        "about": _text(f"{len(rows)} episodes, antway {versions}"),
        "body": body,
        "shell": _json(replays.shell),
        "replays": _json(replays.data),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _asset("report.html"))


class _Replays:
    """The replay pages of failures: the part they share, once, and the data of each."""

    def __init__(self, results: Results, page: Callable[[Trace], str]) -> None:
        self.results, self.page = results, page
        self.shell, self.data = "", list[str]()

    def add(self, row: Row) -> tuple[int, Trace] | None:
        """Return the number under which the page opens the replay, and the trace; None if none was kept."""
        text = self.results.trace(row.key)
        if not text:
            return None
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "trace.json"
            file.write_text(text, encoding="utf-8")
            trace = Trace.load(file)
        found = _DATA.search(page := self.page(trace))
        assert found is not None
        self.shell = page[: found.start(2)] + page[found.end(2) :]
        self.data.append(found[2])
        return len(self.data) - 1, trace


def _suite(suite: str, rows: list[Row], replays: _Replays) -> str:
    policies = sorted({row.policy for row in rows})
    tint = {policy: f"c{i % COLOURS}" + " dashed" * (i // COLOURS % 2) for i, policy in enumerate(policies)}
    table = summarise(rows, policies)
    legend = "".join(f'<li><i class="{tint[p]}"></i>{_text(p)}</li>' for p in policies)
    remarked = "".join(f"<p class='note'>{_text(remark)}</p>" for remark in remarks(table))
    return (
        f"<section><h2>Suite {_text(suite)}</h2>{_table(table)}{remarked}<ul class='legend'>{legend}</ul>"
        f"<div class='plots'>{_success_plot(rows, policies, tint)}{_time_ratio_plot(rows, table, tint)}</div>"
        f"{_rank_table(rows, policies)}<h3>Failures</h3>{_gallery(rows, policies, replays)}</section>"
    )


def _table(table: Sequence[Summary]) -> str:
    heads = (
        "level", "policy", "episodes", "success", "95 %", "hit moving", "hit standing", "hit wall", "timeout", "error",
        "time / optimum", "95 %", "time s", "length / shortest", "clearance m", "under 0.2 m s", "side changes", "jerk m/s³",
        "cycle ms p50", "p99", "max",
    )  # fmt: skip
    lines = []
    for one in table:
        counts = (one.outcomes[name] for name in ("hit-moving", "hit-standing", "hit-wall", "timeout", "error"))
        cells = (
            one.level or "all",
            one.policy,
            one.episodes,
            f"{100 * one.success:.1f} %",
            f"{100 * one.success_interval[0]:.1f}–{100 * one.success_interval[1]:.1f}",
            *counts,
            _number(one.time_ratio, 4),
            "–".join(_number(end, 3) for end in one.time_ratio_interval if math.isfinite(end)) or "–",
            *(_number(v, 2) for v in (one.time, one.path_ratio, one.clearance, one.discomfort, one.side_changes, one.jerk)),
            *(_number(v, 2) for v in one.cycle),
        )
        lines.append(_cells("td", cells))
    return f"<div class='wide'><table><thead>{_cells('th', heads)}</thead><tbody>{''.join(lines)}</tbody></table></div>"


def _rank_table(rows: Sequence[Row], policies: Sequence[str]) -> str:
    """Ranks by success and by time over the optimum; a rank is lost only to a policy that is significantly better."""
    wins, times = paired(rows, policies)
    time = {name: (rank, mean) for name, mean, rank in metrics.ranks(times, most=False)}
    lines = []
    for name, mean, rank in metrics.ranks(wins):
        by_time, ratio = time[name]
        cells = (name, rank, f"{100 * mean:.1f} %", by_time if math.isfinite(ratio) else "–", _number(ratio, 4))
        lines.append(_cells("td", cells))
    paired_all = len(next(iter(wins.values()), ()))
    heads = ("policy", "rank by success", f"of {paired_all} paired", "rank by time / optimum", "mean of those reached")
    return (
        "<h3>Which differences are significant</h3><p>A rank is lost to each policy that is significantly better: on the same "
        "episodes (for time, those in which both reached the goal) the 95 % interval of the difference excludes 0.</p>"
        f"<table><thead>{_cells('th', heads)}</thead><tbody>{''.join(lines)}</tbody></table>"
    )


def _success_plot(rows: Sequence[Row], policies: Sequence[str], tint: dict[str, str]) -> str:
    """Share of the episodes that had reached the goal by a given time."""
    seconds = _round_numbers(0.0, max((row.time for row in rows if row.reached), default=1.0))
    end = seconds[-1]
    curves = []
    for policy in policies:
        mine = [row for row in rows if row.policy == policy]
        times = sorted(row.time for row in mine if row.reached)
        points = [(0.0, 0.0)]
        for i, t in enumerate(times):
            points += [(t, i / len(mine)), (t, (i + 1) / len(mine))]
        curves.append((tint[policy], [*points, (end, len(times) / len(mine))]))
    ticks = [(t, f"{t:g}") for t in seconds]
    scale = [(s / 5, f"{20 * s} %") for s in range(6)]
    return _plot("Reached by", "time, s", ticks, scale, [_line(curve, tint, (end, 1.0)) for tint, curve in curves], (0.0, 0.0))


def _time_ratio_plot(rows: Sequence[Row], table: Sequence[Summary], tint: dict[str, str]) -> str:
    """Mean time over the optimum by level, with its interval."""
    steps = levels(rows)
    known = [one for one in table if one.level in steps and math.isfinite(one.time_ratio)]
    ends = [end for one in known for end in one.time_ratio_interval]
    ratios = _round_numbers(min([1.0, *ends]), max([1.05, *ends]))
    low, end = ratios[0], (max(len(steps) - 1, 1), ratios[-1])
    marks = []
    for policy, colour in tint.items():
        mine = [one for one in known if one.policy == policy]
        marks.append(_line([(steps.index(one.level), one.time_ratio) for one in mine], colour, end, (0.0, low)))
        for one in mine:
            at = float(steps.index(one.level))
            marks.append(
                _line([(at, one.time_ratio_interval[0]), (at, one.time_ratio_interval[1])], colour, end, (0.0, low), bar=True)
            )
    scale = [(v, f"{v:g}") for v in ratios]
    return _plot("Time over the optimum", "level", [(float(i), s) for i, s in enumerate(steps)], scale, marks, (0.0, low), end)


def _round_numbers(low: float, high: float) -> list[float]:
    """Return about five to ten round numbers at equal distances from one not above `low` to one not below `high`."""
    step = 10.0 ** math.floor(math.log10((high - low) / 5))
    step *= next(factor for factor in (1, 2, 5, 10) if (high - low) / (factor * step) <= 10)
    return [round(k * step, 9) for k in range(math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9) + 1)]


def _line(points: Iterable[Point], colour: str, end: Point, origin: Point = (0.0, 0.0), *, bar: bool = False) -> str:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in (_place(p, origin, end) for p in points))
    return f'<polyline class="{colour}{" bar" if bar else ""}" points="{path}"/>'


def _place(point: Point, origin: Point, end: Point) -> Point:
    across, up = ((v - a) / ((b - a) or 1.0) for v, a, b in zip(point, origin, end))
    return LEFT + across * (WIDTH - LEFT - 20), (HEIGHT - BOTTOM) - up * (HEIGHT - BOTTOM - 28)


def _plot(
    title: str,
    below: str,
    ticks: Sequence[tuple[float, str]],
    scale: Sequence[tuple[float, str]],
    marks: Sequence[str],
    origin: Point,
    end: Point | None = None,
) -> str:
    end = end or (ticks[-1][0], scale[-1][0])
    floor = HEIGHT - BOTTOM
    parts = [f'<text class="title" x="{LEFT}" y="16">{_text(title)}</text>']
    for value, label in scale:
        _, y = _place((origin[0], value), origin, end)
        parts.append(f'<path class="rule" d="M{LEFT} {y:.1f}H{WIDTH - 20}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{label}</text>')
    for value, label in ticks:
        x, _ = _place((value, origin[1]), origin, end)
        parts.append(f'<text x="{x:.1f}" y="{floor + 16}" text-anchor="middle">{_text(label)}</text>')
    parts.append(f'<text x="{(LEFT + WIDTH) / 2:.0f}" y="{HEIGHT - 6}" text-anchor="middle">{below}</text>')
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{_text(title)}">{"".join([*parts, *marks])}</svg>'


def _gallery(rows: Sequence[Row], policies: Sequence[str], replays: _Replays) -> str:
    parts = []
    for policy in policies:
        failed = [row for row in rows if row.policy == policy and not row.reached]
        if not failed:
            continue
        pictures = "".join(_thumbnail(row, replays) for row in failed[:GALLERY])
        shown = f"{len(failed)}" if len(failed) <= GALLERY else f"the first {GALLERY} of {len(failed)}"
        parts.append(f"<h4>{_text(policy)}: {shown}</h4><div class='gallery'>{pictures}</div>")
    return "".join(parts) or "<p>None.</p>"


def _thumbnail(row: Row, replays: _Replays) -> str:
    """The episode's last moment as a small picture that opens its replay."""
    caption = f"<b>{_text(row.outcome)}</b> {_text(row.episode)}<br>{_text(row.reason)}"
    found = replays.add(row)
    if found is None:
        return f"<figure><figcaption>{caption}</figcaption></figure>"
    number, trace = found
    grid, size = trace.task.grid, trace.task.grid.resolution
    (x0, y0, _), (rows, cols) = grid.origin, grid.shape
    wall = "".join(_runs(grid.blocked[r], r) for r in range(rows))
    path = " ".join(f"{(x - x0) / size:.1f},{(y - y0) / size:.1f}" for x, y in trace.xy.tolist())
    discs = [(*at, r, "moving") for at, r in zip(trace.obstacle_xy[-1].tolist(), trace.obstacle_radius.tolist())]
    discs += [(*trace.task.goal, 0.2, "goal"), (*trace.xy[-1].tolist(), trace.task.robot.radius, "robot")]
    circles = "".join(
        f'<circle class="{kind}" cx="{(x - x0) / size:.1f}" cy="{(y - y0) / size:.1f}" r="{r / size:.1f}"/>'
        for x, y, r, kind in discs
    )
    picture = (
        f'<svg viewBox="0 0 {cols} {rows}"><g transform="matrix(1 0 0 -1 0 {rows})"><path class="wall" d="{wall}"/>'
        f'<polyline class="path" points="{path}"/>{circles}</g></svg>'
    )
    button = f'<button type="button" data-replay="{number}" title="Play it">{picture}</button>'
    return f"<figure>{button}<figcaption>{caption}</figcaption></figure>"


def _runs(blocked: np.ndarray, row: int) -> str:
    """Rectangles that cover the blocked cells of a row, as an SVG path."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], blocked.astype(np.int8), [0])))).tolist()
    return "".join(f"M{a} {row}h{b - a}v1h{a - b}z" for a, b in zip(edges[::2], edges[1::2]))


def _cells(tag: str, values: Iterable[object]) -> str:
    return "<tr>" + "".join(f"<{tag}>{_text(str(value))}</{tag}>" for value in values) + "</tr>"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def _text(text: str) -> str:
    return html.escape(text)


def _json(value: object) -> str:
    return json.dumps(value).replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _asset(name: str) -> str:
    return (files("antway.arena") / "static" / name).read_text(encoding="utf-8")
