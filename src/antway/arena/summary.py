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


@dataclass(frozen=True, slots=True)
class Summary:
    """The results of a policy on one level of difficulty, or on all levels (level "").

    Time ratio, time, path ratio and clearance are means over the episodes that reached the goal; discomfort, side changes and
    jerk are means over all. The time ratio leaves out episodes whose optimum does not arrive, takes no time or is unknown.
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
    return sorted(found, key=lambda level: (np.nan_to_num(-_mean(found[level])), level))


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
        path_ratio=_mean(metrics.path_ratio([row.length for row in reached], [row.shortest for row in reached])),
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


def markdown(rows: Sequence[Row]) -> str:
    """Return the summaries of the rows of one suite, the ranks of its policies and their failures by cause, in Markdown.

    Ranks are by success and by time over the optimum on the episodes that all policies played; the mean time beside them is of
    those that all reached.
    """
    names = sorted({row.policy for row in rows})
    heads = ["level", "policy", "episodes", "success, % (95 %)", "hit moving / standing / wall", "timeout / error"]
    heads += ["time / optimum (95 %)", "time, s", "length / shortest", "clearance, m", "under 0.2 m, s", "side changes"]
    lines = [_line(heads), _line(["---"] * 2 + ["--:"] * 10)]
    table = summarise(rows, names)
    for one in table:
        low, high = (100 * end for end in one.success_interval)
        cells = (
            one.level or "all",
            one.policy,
            str(one.episodes),
            f"{100 * one.success:.1f} ({low:.1f}–{high:.1f})",
            " / ".join(str(one.outcomes[name]) for name in ("hit-moving", "hit-standing", "hit-wall")),
            " / ".join(str(one.outcomes[name]) for name in ("timeout", "error")),
            _shown(one.time_ratio, f"{one.time_ratio:.4f} ({span(one.time_ratio_interval)})"),
            *(
                _shown(value, f"{value:.2f}")
                for value in (one.time, one.path_ratio, one.clearance, one.discomfort, one.side_changes)
            ),
        )
        lines.append(_line(cells))
    wins, times = paired(rows, names)
    count = len(next(iter(wins.values()), ()))
    heads = ["policy", "rank by success", f"success in {count} paired, %", "rank by time / optimum"]
    heads.append(f"time / optimum in {int(metrics.scored_by_all(times).sum())} that all reached")
    lines += ["", _line(heads), _line(["---"] + ["--:"] * 4)]
    for name, rank, mean, place, ratio in ranked(wins, times):
        lines.append(_line((name, str(rank), f"{100 * mean:.1f}", place, _shown(ratio, f"{ratio:.4f}"))))
    failed = [(name, why, count) for name in names for why, count in by_cause(r for r in rows if r.policy == name).items()]
    if failed:
        lines += ["", _line(["policy", "failures by cause", "episodes"]), _line(["---", "---", "--:"])]
        lines += [_line((name, why, str(count))) for name, why, count in failed]
    return "\n".join([*lines, *(part for remark in remarks(table) for part in ("", remark))]) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def span(ends: metrics.Interval) -> str:
    """Return an interval as text; a dash if there is none."""
    return f"{ends[0]:.3f}–{ends[1]:.3f}" if all(map(math.isfinite, ends)) else "–"


def _shown(value: float, text: str) -> str:
    return text if math.isfinite(value) else "–"
