"""The report is made of the results file alone, opens offline, and treats every name as text."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from antway import run
from antway.arena.engines import Job, play
from antway.arena.metrics import wilson
from antway.arena.store import Results, Row
from antway.arena.suites import episodes, stage
from antway.arena.summary import level_of, levels, markdown, paired, sections, summarise
from antway.view.report import report_page, write_report
from browser import boxes, chromium, needs_browser

POLICIES = ["follow", "oracle"]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "r.db"
    with Results(path) as results:
        for episode in episodes("synthetic", 1)[:6]:
            for policy in POLICIES:
                row, trace = play(Job(episode, policy))
                results.add(row, trace)
        results.add(replace(row, policy="<script>alert(1)</script>", outcome="error", reason="<b>&amp;"))
    return path


@pytest.fixture(scope="module")
def rows(file):
    with Results(file, write=False) as results:
        return results.rows()


@pytest.fixture(scope="module")
def page(file, tmp_path_factory):
    with Results(file, write=False) as results:
        return write_report(results, tmp_path_factory.mktemp("page") / "r.html")


@pytest.fixture(scope="module")
def browser():
    with chromium() as one:
        yield one


def test_rows_measure_the_episode(rows):
    """A row has the episode's own figures, and those of its world."""
    episode = episodes("synthetic", 1)[0]
    scenario, known = stage(episode)
    result = run(scenario, "oracle", seed=episode.seed)
    row = next(row for row in rows if row.episode == episode.name and row.policy == "oracle")
    assert (row.time, row.length, row.clearance) == (result.time, result.length, result.min_clearance)
    assert (row.bound, row.shortest, row.difficulty) == (known.bound, known.shortest, known.difficulty)
    assert (
        row.side_changes >= 0 and row.discomfort >= 0.0 and row.jerk > 0.0 and row.cycle_p50 <= row.cycle_p99 <= row.cycle_max
    )


def test_summaries(rows):
    """Counts add up, levels come easiest first, the oracle is at its bound, and pairs share their episodes."""
    rows = [row for row in rows if row.policy in POLICIES]
    table = {(one.level, one.policy): one for one in summarise(rows)}
    ease = [np.mean([row.difficulty for row in rows if level_of(row) == level]) for level in levels(rows)]
    assert ease == sorted(ease, reverse=True) and len(ease) == 6 and ("", "oracle") in table
    for one in table.values():
        assert sum(one.outcomes.values()) == one.episodes
        assert one.success_interval[0] <= one.success <= one.success_interval[1]
    assert table["", "oracle"].success == 1.0 and 1.0 - 1e-9 <= table["", "oracle"].time_ratio < 1.05
    wins, times = paired(rows, POLICIES)
    assert all(len(part) == 6 for part in wins.values())
    assert len({len(part) for part in times.values()}) == 1


def test_a_summary_by_hand():
    """Means are over those that reached the goal or over all, as each number says; levels nobody knows come last."""
    inf, nan = math.inf, math.nan

    def row(episode: str, outcome: str = "reached", *numbers: float, policy: str = "a") -> Row:
        return Row("s", episode, policy, 1, "0", episode.rpartition("/")[0], outcome, "", *numbers)

    one = row("open/low/1", "reached", 12.0, 11.0, 0.5, 0.2, 1, 7, 8, 1.0, 10.0, 10.0, 0.9, 1.0, 2.0, 3.0)
    two = row("aisles/low/1", "reached", 30.0, 20.0, inf, 0.0, 3, 7, 8, 2.0, inf, 10.0, 0.7, 3.0, 4.0, 9.0)
    hit = row("open/low/2", "hit-moving", 5.0, 5.0, 0.0, 1.0, 2, 7, 8, 3.0, 10.0, 10.0, 0.8, 2.0, 3.0, 4.0)
    hung, died = row("open/hung/1", "timeout"), row("open/unknown/1", "error", policy="b")
    slow = row("open/low/1", "timeout", 60.0, policy="b")
    easy = row("open/easy/1", "hit-wall", *[nan] * 4, 0, 0, 0, nan, 9.0, 9.0, 0.95, policy="b")
    rows = [hung, died, slow, easy, one, two, hit]
    assert levels(rows) == ["easy", "low", "hung", "unknown"]
    assert levels([*rows, replace(one, group="open/worst", difficulty=0.0)])[1:3] == ["low", "worst"]
    table = {(line.level, line.policy): line for line in summarise(rows)}
    assert list(table) == [("easy", "b"), ("low", "a"), ("low", "b"), ("hung", "a"), ("unknown", "b"), ("", "a"), ("", "b")]
    low = table["low", "a"]
    assert (low.episodes, low.outcomes["reached"], low.outcomes["hit-moving"], sum(low.outcomes.values())) == (3, 2, 1, 3)
    assert (low.success, low.success_interval) == (2 / 3, wilson(2, 3))
    assert (low.time_ratio, low.time, low.path_ratio, low.clearance) == (1.2, 21.0, pytest.approx(1.55), 0.5)
    assert (low.discomfort, low.side_changes, low.jerk, low.cycle) == (pytest.approx(0.4), 2.0, 2.0, (2.0, 3.0, 9.0))
    assert all(map(math.isnan, (*low.time_ratio_interval, table["hung", "a"].time, *table["hung", "a"].cycle)))
    assert table["", "a"].episodes == 4 and table["", "a"].success == 0.5
    wins, times = paired(rows, ["a", "b"])
    assert [part.tolist() for part in wins.values()] == [[1.0], [0.0]]
    assert times["a"].tolist() == [1.2] and math.isnan(times["b"][0])
    assert list(sections([replace(one, suite="t"), one])) == ["t", "s"]
    assert [line.level for line in summarise([one])] == ["low"]
    assert [[line.policy for line in summarise([slow, one], order)] for order in (None, ["b", "a"])] == [["a", "b"], ["b", "a"]]
    assert [line.level for line in summarise([hung, one])] == ["low", "hung", ""]
    assert math.isnan(paired([died, replace(died, policy="c")], ["b", "c"])[1]["c"][0]), "nobody knows the optimum"
    fast = replace(one, episode="open/easy/1", group="open/easy", time=9.0, difficulty=1.0)
    printed = markdown([fast, one, replace(hit, outcome="hit-standing", time=9.0), replace(slow, outcome="error")])
    assert printed == PRINTED


PRINTED = (
    "| level | policy | episodes | success, % (95 %) | hit moving / standing / wall | timeout / error | time / optimum (95 %)"
    """ | time, s | length / shortest | clearance, m | under 0.2 m, s | side changes |
| --- | --- | --: | --: | --: | --: | --: | --: | --: | --: | --: | --: |
| easy | a | 1 | 100.0 (20.7–100.0) | 0 / 0 / 0 | 0 / 0 | 0.9000 (–) | 9.00 | 1.10 | 0.50 | 0.20 | 1.00 |
| low | a | 2 | 50.0 (9.5–90.5) | 0 / 1 / 0 | 0 / 0 | 1.2000 (–) | 12.00 | 1.10 | 0.50 | 0.60 | 1.50 |
| low | b | 1 | 0.0 (0.0–79.3) | 0 / 0 / 0 | 0 / 1 | – | – | – | – | – | 0.00 |
| all | a | 3 | 66.7 (20.8–93.9) | 0 / 1 / 0 | 0 / 0 | 1.0500 (0.000–2.956) | 10.50 | 1.10 | 0.50 | 0.47 | 1.33 |
| all | b | 1 | 0.0 (0.0–79.3) | 0 / 0 / 0 | 0 / 1 | – | – | – | – | – | 0.00 |

| policy | rank by success | success in 1 paired, % | rank by time / optimum | time / optimum in 1 that all reached |
| --- | --: | --: | --: | --: |
| a | 1 | 100.0 | – | 1.2000 |
| b | 1 | 0.0 | – | – |

| policy | failures by cause | episodes |
| --- | --- | --: |
| a | hit-standing | 1 |
| b | error | 1 |

A ratio below 1: the optimum moves between cells in 32 directions, a policy at any angle.
"""
)


def test_markdown_has_every_summary_and_rank(rows):
    """One line for each summary and each policy's rank, as many cells as heads; numbers that there are none of are dashes."""
    rows = [row for row in rows if row.policy in POLICIES]
    levels_table, ranks_table, failures, *_ = (part.splitlines() for part in markdown(rows).split("\n\n"))
    assert len(levels_table) == 2 + len(summarise(rows)) and len(ranks_table) == 2 + len(POLICIES)
    failed = sum(row.policy in POLICIES and not row.reached for row in rows)
    assert failed and sum(int(line.split("|")[3]) for line in failures[2:]) == failed
    for table in (levels_table, ranks_table, failures):
        assert {line.count("|") for line in table} == {table[0].count("|")} and "nan" not in "".join(table)
    assert "| oracle | 1 | 100.0 |" in ranks_table[2]
    times = np.array(list(paired(rows, POLICIES)[1].values()))
    assert f"time / optimum in {np.isfinite(times).all(axis=0).sum()} that all reached |" in ranks_table[0]


def test_failures_keep_their_trace(file, rows):
    """A failed episode has its trace in the file, a reached one has none."""
    with Results(file, write=False) as results:
        for row in rows:
            assert bool(results.trace(row.key)) == (not row.reached and row.policy in POLICIES)


def test_the_page_is_whole_and_safe(file, page):
    """Nothing is fetched, names are text, every plot and table is there, and the same file gives the same page."""
    with Results(file, write=False) as results:
        assert report_page(results) == page.read_text(encoding="utf-8")
    page = page.read_text(encoding="utf-8")
    assert "<script>alert(1)" not in page and "&lt;script&gt;alert(1)" in page
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", page)
    for part in (
        "Suite synthetic",
        "Reached by level",
        "Time over the optimum",
        "Which differences are significant",
        "data-replay=",
    ):
        assert part in page
    assert "nan" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL).replace("significant", "")
    assert " style=" not in page, "which the page's own policy forbids"


def test_an_empty_file_makes_a_page(tmp_path):
    """Without rows the report says so and stands."""
    with Results(tmp_path / "r.db") as results:
        assert "0 episodes" in report_page(results)


@needs_browser
@pytest.mark.parametrize("width", [390, 1400])
def test_the_page_fits_the_screen(page, browser, width):
    """Nothing runs off the side, and every plot and every label lies within its picture, which has the page's colours."""
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme="light")
    tab, printed = context.new_page(), []
    tab.on("console", lambda message: printed.append(message.text))
    tab.goto(page.as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth") <= width and printed == []
    plots = tab.locator(".plots svg")
    assert plots.count() == 2
    for plot in plots.all():
        outer, texts = plot.bounding_box(), boxes(plot.locator("text"))
        assert texts
        for inner in texts:
            assert inner["x"] >= outer["x"] - 1 and inner["x"] + inner["width"] <= outer["x"] + outer["width"] + 1
            assert inner["y"] >= outer["y"] - 1 and inner["y"] + inner["height"] <= outer["y"] + outer["height"] + 1
    for colours, ink in (("light", "rgb(27, 31, 36)"), ("dark", "rgb(233, 236, 240)")):
        tab.emulate_media(color_scheme=colours)
        for plot in plots.all():
            assert plot.locator("text").first.evaluate("e => getComputedStyle(e).fill") == ink
    context.close()


@needs_browser
def test_a_thumbnail_opens_the_replay(page, browser):
    """In a browser: no error, no request, and a click on a failure plays it."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    tab, printed, asked = context.new_page(), [], []
    context.on("console", lambda message: printed.append(message.text))
    context.on("request", lambda request: asked.append(request.url))
    tab.goto(page.as_uri())
    with context.expect_page() as opened:
        tab.locator("[data-replay]").first.click()
    opened.value.wait_for_selector("#outcome")
    assert "synthetic" in opened.value.locator("#title").inner_text()
    assert not printed and all(url.startswith(("file:", "blob:", "data:")) for url in asked)
    context.close()


def test_a_trace_has_the_policys_name_as_it_was_given():
    """Replays of the report show it, with its options."""
    traces = (play(Job(episode, "sipp/predictions=frozen"))[1] for episode in episodes("synthetic", 1))
    assert json.loads(next(filter(None, traces)))["policy"] == "sipp/predictions=frozen"


def test_a_ratio_below_one_is_explained(rows):
    """Where a policy is faster than the optimum the tables say how that can be, and only there."""
    row = next(row for row in rows if row.reached and row.policy == "oracle")
    for time, told in ((0.9 * row.bound, True), (row.bound, False), (1.1 * row.bound, False)):
        assert ("A ratio below 1" in markdown([replace(row, time=time)])) is told
