"""Charts of the arena's results."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from antway.arena import metrics
from antway.arena.store import Row
from antway.arena.summary import Summary
from antway.errors import BadParameter
from antway.view import style

_LOOKS = tuple(zip(style.COLOURS, "os^DvP", style.DASHES, strict=True))  # of policies: colour, marker and line


@style.styled
def success_figure(table: Sequence[Summary]) -> Figure:
    """Draw the share of episodes that reached the goal, by level and policy, with 95 % intervals.

    Of a table of `antway.arena.summary.summarise`, rows over all levels are left out if there are others.
    """
    if not table:
        raise BadParameter("table", table, "at least one summary")
    levels = list(dict.fromkeys(row.level for row in table if row.level)) or [""]
    policies = list(dict.fromkeys(row.policy for row in table))
    axes = style.figure(6.0, 4.2).subplots()
    for k, (policy, (colour, marker, _)) in enumerate(zip(policies, cycle(_LOOKS))):
        rows = {row.level: row for row in table if row.policy == policy}
        known = [(i, rows[level]) for i, level in enumerate(levels) if level in rows]
        x = np.array([i for i, _ in known]) + 0.5 * (k - (len(policies) - 1) / 2) / max(len(policies), 2)
        share = np.array([100 * row.success for _, row in known])
        low, high = 100 * np.array([row.success_interval for _, row in known]).reshape(-1, 2).T
        bars = np.maximum([share - low, high - share], 0.0)
        look: dict[str, Any] = {"color": colour, "marker": marker, "linestyle": "", "markersize": 5}
        axes.errorbar(x, share, yerr=bars, capsize=2.5, elinewidth=1.0, **look)
        axes.plot([], [], label=style.plain(policy), **look)
    axes.set_xticks(range(len(levels)), [style.plain(level or "all") for level in levels])
    if sum(map(len, levels)) > 48:  # letters that fit side by side
        axes.tick_params("x", rotation=25)
    axes.set(xlabel="level", ylabel="reached (%)", title="Episodes in which the goal was reached")
    axes.set(ylim=(-3, 103), xlim=(-0.5, len(levels) - 0.5))
    style.graph(axes, below=True)
    return style.legend_below(axes)


@style.styled
def time_ratio_figure(rows: Sequence[Row]) -> Figure:
    """Draw for each policy the share of all episodes that reached the goal within a multiple of the clairvoyant optimum.

    Parameters
    ----------
    rows : sequence of Row
        Rows without a bound are left out; failed episodes count as never reached.
    """
    bound = [row for row in rows if np.isfinite(row.bound)]
    if not bound:
        raise BadParameter("rows", len(rows), "rows with a bound")
    axes = style.figure(6.0, 4.2).subplots()
    most = 1.0
    for policy, (colour, _, dash) in zip(dict.fromkeys(row.policy for row in bound), cycle(_LOOKS)):
        mine = [row for row in bound if row.policy == policy]
        reached = [row for row in mine if row.reached]
        ratio = np.sort(metrics.time_ratio([row.time for row in reached], [row.bound for row in reached]))
        share = 100 * np.arange(1, len(ratio) + 1) / len(mine)
        most = max(most, float(np.percentile(ratio, 98)) if len(ratio) else 1.0)
        x, y = np.concatenate(([0.0], ratio, [1e9])), np.concatenate(([0.0], share, share[-1:] if len(share) else [0.0]))
        axes.step(x, y, where="post", color=colour, linestyle=dash, linewidth=1.8, label=style.plain(policy))
    axes.set(xlabel="time / optimum", ylabel="episodes (%)", title="Time over the clairvoyant optimum")
    axes.set(xlim=(0.95, 1.05 * most + 0.05), ylim=(-3, 103))
    style.graph(axes, below=True)
    return style.legend_below(axes)
