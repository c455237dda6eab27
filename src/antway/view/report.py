"""The report: an HTML page with tables, plots and failures, made from the results file."""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from antway.arena.store import Results, Row
from antway.arena.summary import rank_cells, remarks, sections, summarise, summary_cells
from antway.view import style
from antway.view.animation import last_moment
from antway.view.charts import success_figure, time_ratio_figure
from antway.view.pages import asset, digest, embedded, filled, png_url
from antway.view.replay import replay_page
from antway.world.trace import Trace

GALLERY = 8  # number of failures shown for each policy
WIDE = 320  # px; width of a failure's picture
_DATA = re.compile(r'(<script type="application/json" id="episode">)(.*?)(</script>)', re.DOTALL)


def write_report(results: Results, path: str | Path) -> Path:
    """Write the report on everything in `results`; return its path."""
    path = Path(path)
    path.write_text(report_page(results), encoding="utf-8")
    return path


def report_page(results: Results) -> str:
    """Return the page as text; it works offline, and its security policy allows only its own scripts."""
    rows = results.rows()
    replays = _Replays(results)
    body = "".join(_suite(name, played, replays) for name, played in sections(rows).items())
    style, script = asset("report.css"), asset("report.js")
    hashes = {"script": [digest(script)], "style": [digest(style)]}
    for kind, found in re.findall(r"(script|style)-src '(sha256-[^']+)'", replays.shell):
        hashes[kind].append(found)  # a replay opened from this page must satisfy the policy of this page as well
    allowed = "; ".join(f"{kind}-src {' '.join(map(repr, values))}" for kind, values in hashes.items())
    versions = ", ".join(sorted({row.version for row in rows}))
    parts = {
        "policy": f"default-src 'none'; {allowed}; img-src data: blob:; base-uri 'none'; form-action 'none'",
        "style": style,
        "script": script,
        "about": escape(f"{len(rows)} episodes, antway {versions}"),
        "body": body,
        "shell": embedded(json.dumps(replays.shell)),
        "replays": embedded(json.dumps(replays.data)),
    }
    return filled(asset("report.html"), parts)


class _Replays:
    """The replay pages of failures: the common part, and the data of each."""

    def __init__(self, results: Results) -> None:
        self.results = results
        self.shell, self.data = "", list[str]()

    def add(self, row: Row) -> tuple[int, Trace] | None:
        """Return the number of the replay on the page, and the trace; None if none was kept."""
        text = self.results.trace(row.key)
        if not text:
            return None
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "trace.json"
            file.write_text(text, encoding="utf-8")
            trace = Trace.load(file)
        found = _DATA.search(page := replay_page(trace))
        assert found is not None
        self.shell = page[: found.start(2)] + page[found.end(2) :]
        self.data.append(found[2])
        return len(self.data) - 1, trace


def _suite(suite: str, rows: list[Row], replays: _Replays) -> str:
    """Return the section of a suite: its table, plots, ranks and failures."""
    policies = sorted({row.policy for row in rows})
    table = summarise(rows, policies)
    plots = {"Reached by level": success_figure(table)}
    if any(math.isfinite(row.bound) for row in rows):
        plots["Time over the optimum"] = time_ratio_figure(rows)
    drawn = "".join(f"<div class='wide' role='img' aria-label='{name}'>{style.svg(fig)}</div>" for name, fig in plots.items())
    remarked = "".join(f"<p class='note'>{escape(remark)}</p>" for remark in remarks(table))
    return (
        f"<section><h2>Suite {escape(suite)}</h2>{_table([summary_cells(one) for one in table])}{remarked}"
        f"<div class='plots'>{drawn}</div><h3>Which differences are significant</h3><p>A rank is lost to each policy that is "
        "significantly better: on the same episodes (for time, those in which both reached the goal) the 95 % interval of the "
        f"difference excludes 0.</p>{_table(rank_cells(rows, policies), ' ranks')}"
        f"<h3>Failures</h3>{_gallery(rows, policies, replays)}</section>"
    )


def _table(rows: Sequence[dict[str, str]], kind: str = "") -> str:
    """Return a table of rows of cells by their heads, with a class besides that of wide tables."""
    lines = (_cells("td", row.values()) for row in rows)
    return f"<div class='wide{kind}'><table><thead>{_cells('th', rows[0])}</thead><tbody>{''.join(lines)}</tbody></table></div>"


def _gallery(rows: Sequence[Row], policies: Sequence[str], replays: _Replays) -> str:
    """Return pictures of the first failures of each policy, which open their replays."""
    parts = []
    for policy in policies:
        failed = [row for row in rows if row.policy == policy and not row.reached]
        if not failed:
            continue
        pictures = "".join(_thumbnail(row, replays) for row in failed[:GALLERY])
        shown = f"{len(failed)}" if len(failed) <= GALLERY else f"the first {GALLERY} of {len(failed)}"
        parts.append(f"<h4>{escape(policy)}: {shown}</h4><div class='gallery'>{pictures}</div>")
    return "".join(parts) or "<p>None.</p>"


def _thumbnail(row: Row, replays: _Replays) -> str:
    """Return the last moment of an episode as a small picture that opens its replay."""
    caption = f"<b>{escape(row.outcome)}</b> {escape(row.episode)}<br>{escape(row.reason)}"
    found = replays.add(row)
    if found is None:
        return f"<figure><figcaption>{caption}</figcaption></figure>"
    number, trace = found
    source = png_url(last_moment(trace, WIDE).quantize(32))
    picture = f'<img alt="The last moment of {escape(row.episode)}" src="{source}">'
    button = f'<button type="button" data-replay="{number}" title="Play it">{picture}</button>'
    return f"<figure>{button}<figcaption>{caption}</figcaption></figure>"


def _cells(tag: str, values: Iterable[object]) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(str(value))}</{tag}>" for value in values) + "</tr>"
