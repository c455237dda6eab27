"""Summaries of results: by level of difficulty and policy, and paired on the same episodes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway.arena import metrics
from antway.arena.causes import by_cause
from antway.arena.store import Row
from antway.world.trace import Outcome

JERK, CYCLE = "jerk, m/s³", "cycle, ms: p50 / p99 / longest"
MEANS = ("time, s", "length / shortest", "clearance, m", "under 0.2 m, s", "side changes", JERK)  # heads of columns


@dataclass(frozen=True, slots=True)
class Summary:
    """The results of a policy on one level of difficulty, or on all levels (level "").

    Time ratio, time, path ratio and clearance are means over the episodes that reached the goal; discomfort, side changes and
    jerk are means over all. The time ratio leaves out episodes whose optimum does not arrive, takes no time or is unknown; the
    path ratio leaves out those whose shortest path has no length, or is none for the robot's disc, though its body may fit.
    """

    level: str
    policy: str
    episodes: int
    outcomes: dict[str, int]  # how many have each value of `Outcome`
    success: float
    success_interval: metrics.Interval  # Wilson's, 95 %
    time_ratio: float  # time over the clairvoyant optimum; less than 1 is possible, because the optimum moves on a grid
    time_ratio_interval: metrics.Interval  # of its mean, 95 %, not below 0; NaN for fewer than two episodes
    time: float  # s
    path_ratio: float  # length over the shortest path among the walls
    clearance: float  # m; the smallest of an episode
    discomfort: float  # s; time spent nearer than 0.2 m
    side_changes: float
    jerk: float  # m/s^3
    cycle: tuple[float, float, float]  # ms; medians of the episodes' medians and 99th percentiles, and the longest cycle


def level_of(row: Row) -> str:
    """Return the level of a group "kind/level", else the group."""
    return row.group.rpartition("/")[2]


def levels(rows: Sequence[Row]) -> list[str]:
    """Return the levels, the easiest (largest mean `difficulty`) first, and last those of which nobody knows it."""
    found: dict[str, list[float]] = {}
    for row in rows:
        found.setdefault(level_of(row), []).append(row.difficulty)
    return sorted(found, key=lambda level: (np.nan_to_num(-_mean(found[level]), nan=1.0), level))


def summarise(rows: Sequence[Row], policies: Sequence[str] | None = None) -> list[Summary]:
    """Return a summary for each level and policy, and for all levels together if there are several."""
    steps = levels(rows)
    names = list(policies or sorted({row.policy for row in rows}))
    table = []
    for level in [*steps, ""] if len(steps) > 1 else steps:
        for policy in names:
            mine = [row for row in rows if row.policy == policy and level in (level_of(row), "")]
            if mine:
                table.append(_summary(level, policy, mine))
    return table


def _summary(level: str, policy: str, rows: Sequence[Row]) -> Summary:
    outcomes = [row.outcome for row in rows]
    reached = [row for row in rows if row.reached]
    bound = [row for row in reached if 0.0 < row.bound < math.inf]
    long = [row for row in reached if 0.0 < row.shortest < math.inf]
    ratios = metrics.time_ratio([row.time for row in bound], [row.bound for row in bound])
    low, high = metrics.mean_interval(ratios)
    return Summary(
        level=level,
        policy=policy,
        episodes=len(rows),
        outcomes={outcome.value: outcomes.count(outcome.value) for outcome in Outcome},
        success=len(reached) / len(rows),
        success_interval=metrics.wilson(len(reached), len(rows)),
        time_ratio=_mean(ratios),
        time_ratio_interval=(max(low, 0.0), high),
        time=_mean([row.time for row in reached]),
        path_ratio=_mean(metrics.path_ratio([row.length for row in long], [row.shortest for row in long])),
        clearance=_mean([row.clearance for row in reached if math.isfinite(row.clearance)]),
        discomfort=_mean([row.discomfort for row in rows]),
        side_changes=_mean([row.side_changes for row in rows]),
        jerk=_mean([row.jerk for row in rows]),
        cycle=(
            _median([row.cycle_p50 for row in rows]),
            _median([row.cycle_p99 for row in rows]),
            max((row.cycle_max for row in rows if row.cycle_max == row.cycle_max), default=math.nan),
        ),
    )


def _mean(values: Sequence[float] | NDArray[np.float64]) -> float:
    kept = [value for value in values if math.isfinite(value)]
    return math.fsum(kept) / len(kept) if kept else math.nan


def _median(values: Sequence[float]) -> float:
    kept = [value for value in values if math.isfinite(value)]
    return float(np.median(kept)) if kept else math.nan


def paired(rows: Sequence[Row], policies: Sequence[str]) -> tuple[metrics.Scores, metrics.Scores]:
    """Return success (0 or 1) and time over the optimum (NaN if not reached) on the episodes that all policies played."""
    by: dict[tuple[str, str, int, str], dict[str, Row]] = {}
    for row in rows:
        by.setdefault((row.suite, row.episode, row.seed, row.version), {})[row.policy] = row
    common = [one for one in by.values() if all(policy in one for policy in policies)]
    wins = {p: np.array([float(one[p].reached) for one in common]) for p in policies}
    # The optimum is that of the episode; the row of a policy that hung or ended its process does not know it.
    bounds = [min((row.bound for row in one.values() if math.isfinite(row.bound)), default=math.nan) for one in common]
    times = {p: metrics.time_ratio([one[p].time if one[p].reached else math.nan for one in common], bounds) for p in policies}
    return wins, times


def ranked(wins: metrics.Scores, times: metrics.Scores) -> list[tuple[str, int, float, str, float]]:
    """Return policy, rank by success, success, rank by time and mean time over the optimum, best first.

    `wins` and `times` are those of `paired`. The rank by time is a dash for a policy with fewer than ten times: it cannot be
    significantly slower than another one, and would be first.
    """
    few = {name for name, mine in times.items() if np.isfinite(mine).sum() < metrics.PAIRS}
    by_time = {name: ("–" if name in few else str(rank), mean) for name, mean, rank in metrics.ranks(times, most=False)}
    return [(name, rank, mean, *by_time[name]) for name, mean, rank in metrics.ranks(wins)]


def sections(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows of each suite by its name; those of each version of antway on their own where there are several."""
    several, found = len({row.version for row in rows}) > 1, dict[str, list[Row]]()
    for row in rows:
        found.setdefault(f"{row.suite}, antway {row.version}" if several else row.suite, []).append(row)
    return found


def remarks(table: Sequence[Summary]) -> list[str]:
    """Return remarks for the reader of a table: why a time can be below the optimum, if one is."""
    below = any(one.time_ratio < 1.0 for one in table)
    return ["A ratio below 1: the optimum moves between cells in 32 directions, a policy at any angle."] if below else []


def summary_cells(one: Summary) -> dict[str, str]:
    """Return what tables show of a summary, by the heads of their columns; a dash where there is no number."""
    low, high = (100 * end for end in one.success_interval)
    means = one.time, one.path_ratio, one.clearance, one.discomfort, one.side_changes, one.jerk
    return {
        "level": one.level or "all",
        "policy": one.policy,
        "episodes": str(one.episodes),
        "success, % (95 %)": f"{100 * one.success:.1f} ({low:.1f}–{high:.1f})",
        "hit moving / standing / wall": " / ".join(str(one.outcomes[f"hit-{what}"]) for what in ("moving", "standing", "wall")),
        "timeout / error": f"{one.outcomes['timeout']} / {one.outcomes['error']}",
        "time / optimum (95 %)": _shown(one.time_ratio, f"{one.time_ratio:.4f} ({_span(one.time_ratio_interval)})"),
        **{head: _shown(mean, f"{mean:.2f}") for head, mean in zip(MEANS, means, strict=True)},
        CYCLE: " / ".join(_shown(time, f"{time:.2f}") for time in one.cycle),
    }


def rank_cells(rows: Sequence[Row], policies: Sequence[str]) -> list[dict[str, str]]:
    """Return the ranks of policies, best first, by the heads of a table's columns.

    Ranks are by success and by time over the optimum on the episodes that all policies played; the mean time beside them is of
    those that all reached.
    """
    wins, times = paired(rows, policies)
    count, shared = len(next(iter(wins.values()), ())), int(metrics.scored_by_all(times).sum())
    return [
        {
            "policy": name,
            "rank by success": str(rank),
            f"success in {count} paired, %": f"{100 * mean:.1f}",
            "rank by time / optimum": place,
            f"time / optimum in {shared} that all reached": _shown(ratio, f"{ratio:.4f}"),
        }
        for name, rank, mean, place, ratio in ranked(wins, times)
    ]


def markdown(rows: Sequence[Row]) -> str:
    """Return the summaries of the rows of one suite, the ranks of its policies and their failures by cause, in Markdown."""
    names = sorted({row.policy for row in rows})
    table = summarise(rows, names)
    cells = [{head: cell for head, cell in summary_cells(one).items() if head not in (JERK, CYCLE)} for one in table]
    lines = _lines(cells, 2)
    lines += ["", *_lines(rank_cells(rows, names), 1)]
    failed = [(name, why, count) for name in names for why, count in by_cause(r for r in rows if r.policy == name).items()]
    if failed:
        causes = [{"policy": name, "failures by cause": why, "episodes": str(count)} for name, why, count in failed]
        lines += ["", *_lines(causes, 2)]
    return "\n".join([*lines, *(part for remark in remarks(table) for part in ("", remark))]) + "\n"


def _lines(rows: Sequence[dict[str, str]], left: int) -> list[str]:
    """Return a table in Markdown, whose first `left` columns are aligned left."""
    ruler = ["---"] * left + ["--:"] * (len(rows[0]) - left)
    lines = (rows[0], ruler, *(row.values() for row in rows))
    texts = (" | ".join(cell.replace("|", "\\|") for cell in cells) for cells in lines)
    return [f"| {text} |" for text in texts]


def _span(ends: metrics.Interval) -> str:
    """Return an interval as text; a dash if there is none."""
    return f"{ends[0]:.3f}–{ends[1]:.3f}" if all(map(math.isfinite, ends)) else "–"


def _shown(value: float, text: str) -> str:
    return text if math.isfinite(value) else "–"
