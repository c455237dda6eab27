"""Flow charts of what the code does: Figures 1 to 3 of the paper, drawn from lists of boxes and arrows."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Polygon

from antway.view import style

WIDE, HIGH, PITCH = 3.4, 0.62, 1.02  # width and height of a box, and distance of rows


@dataclass(frozen=True, slots=True)
class Box:
    """A box of a chart, with its centre at column `column` and row `row`; `kind` is end, step or question."""

    text: str
    row: float
    column: float = 0.0
    kind: str = "step"

    @property
    def centre(self) -> tuple[float, float]:
        return self.column * 4.3, -self.row * PITCH

    @property
    def height(self) -> float:
        return HIGH + 0.14 * (self.text.count("\n") - 1) + (0.3 if self.kind == "question" else 0.0)


@dataclass(frozen=True, slots=True)
class Arrow:
    """From box `a` to box `b`: straight, `left` or `right` around the boxes between, `across` to the next column, or `back`."""

    a: str
    b: str
    label: str = ""
    side: str = ""


_OPENING = {
    "start": Box("Start", 0, kind="end"),
    "init": Box("Set parameters and the same pheromone\n$\\tau_{ij}(0) = C$ on every edge; t = 0", 1),
}


def _closing(row: float) -> dict[str, Box]:
    """Return the last boxes of a colony's chart, from `row` on."""
    return {
        "last": Box("Last cycle?", row, kind="question"),
        "out": Box("Shortest tour", row + 1.1),
        "end": Box("End", row + 2.0, kind="end"),
    }


@style.styled
def ant_system_chart() -> Figure:
    """Fig. 1: the Ant System on the travelling salesman problem (III.C), Eqs. (1) and (2)."""
    return _chart(
        "Ant System on the travelling salesman problem",
        {
            **_OPENING,
            "place": Box("Next cycle: place m ants on the n cities", 2),
            "choose": Box("Each ant draws its next city, not yet\nvisited, by roulette: Eq. (1)", 3),
            "done": Box("All n cities\nvisited?", 4.15, kind="question"),
            "best": Box("Close each tour, measure its length $L_k$;\nkeep the shortest so far", 5.3),
            "update": Box(
                "Eq. (2): $\\tau_{ij} \\leftarrow \\rho\\,\\tau_{ij} + \\Sigma_k\\, Q / L_k$\non each tour's edges; t += n", 6.3
            ),
            **_closing(7.4),
        },
        [
            *_down("start init place choose done best update last out end", done="yes", last="yes"),
            Arrow("done", "choose", "no", "right"),
            Arrow("last", "place", "no", "left"),
        ],
    )


@style.styled
def improved_chart() -> Figure:
    """Fig. 2: the improved Ant System, whose persistence adapts edge by edge (III.D in the reading used)."""
    return _chart(
        "Ant System with adaptive persistence",
        {
            **_OPENING,
            "walk": Box("Next cycle: m ants build tours of all n cities,\neach step by roulette: Eq. (1)", 2),
            "best": Box("Measure the length $L_k$ of each tour;\nkeep the shortest so far", 3),
            "weakest": Box("$\\tau_{\\min}$ = weakest pheromone of all edges", 4),
            "adapt": Box(
                "Persistence of each edge\n$\\rho_{ij} = \\mathrm{clip}(e^{-\\tau_{\\min}/\\tau_{ij}} + e^{-t},\\ 0.1,\\ 0.9)$",
                5,
            ),
            "update": Box(
                "$\\tau_{ij} \\leftarrow \\rho_{ij}\\,\\tau_{ij} + \\Sigma_k\\, Q / L_k$\non each tour's edges; t += n", 6.1
            ),
            **_closing(7.2),
        },
        [*_down("start init walk best weakest adapt update last out end", last="yes"), Arrow("last", "walk", "no", "left")],
    )


@style.styled
def avoidance_chart() -> Figure:
    """Fig. 3: the robot's path among moving obstacles, Steps 1 to 8."""
    return _chart(
        "A robot among moving obstacles",
        {
            "start": Box("Start", 0, kind="end"),
            "init": Box("Step 1: read map, start, goal;\nset the colony's parameters", 1),
            "global": Box("Step 2: shortest path by Dijkstra\non the known map", 2),
            "sense": Box("Step 3: sense; predict how\neach obstacle will move", 3),
            "meet": Box("Conflict on the\npath ahead?", 4.15, kind="question"),
            "move": Box("Move on along the path", 5.3),
            "goal": Box("Goal reached?", 6.35, kind="question"),
            "end": Box("End", 7.4, kind="end"),
            "target": Box("Local target on the global path,\nbeyond the obstacle", 3, 1),
            "walk": Box("Step 4: ants walk there in the sensed\nwindow, each step by roulette, Eq. (1)", 4.15, 1),
            "arrive": Box("Step 5: within the step limit;\nkeep the shortest path", 5.3, 1),
            "update": Box("Step 6: pheromone from the ants\nthat arrived, Eq. (2)", 6.35, 1),
            "last": Box("Step 7: last cycle?", 7.4, 1, "question"),
            "take": Box("Step 8: take the best path, or wait if that is\nshorter; rejoin the global path", 8.5, 1),
        },
        [
            *_down("start init global sense meet move goal end", meet="no", goal="yes"),
            *_down("target walk arrive update last take", last="yes"),
            Arrow("meet", "target", "yes", "across"),
            Arrow("last", "walk", "no", "right"),
            Arrow("goal", "sense", "no", "left"),
            Arrow("take", "sense", side="back"),
        ],
    )


def _down(names: str, **labels: str) -> list[Arrow]:
    """Return the arrows from each of the named boxes to the next, with the label that `labels` has for a box."""
    return [Arrow(a, b, labels.get(a, "")) for a, b in pairwise(names.split())]


def _chart(title: str, boxes: dict[str, Box], arrows: list[Arrow]) -> Figure:
    """Draw a chart, as large as its boxes need."""
    columns = [box.centre[0] for box in boxes.values()]
    left, right = min(columns) - WIDE / 2 - 1.1, max(columns) + WIDE / 2 + 0.8
    bottom = min(box.centre[1] - box.height / 2 for box in boxes.values()) - 0.5
    fig = style.figure(0.92 * (right - left), 0.78 * (0.75 - bottom) + 0.3)
    axes = fig.subplots()
    axes.set(xlim=(left, right), ylim=(bottom, 0.75), aspect="equal")
    axes.set_axis_off()
    axes.set_title(title, loc="center")
    for arrow in arrows:
        _draw_arrow(axes, boxes[arrow.a], boxes[arrow.b], arrow)
    for box in boxes.values():
        _draw_box(axes, box)
    return fig


def _draw_box(axes: Axes, box: Box) -> None:
    (x, y), half, high = box.centre, WIDE / 2, box.height / 2
    look: dict[str, Any] = {"edgecolor": style.INK, "linewidth": 1.1, "zorder": 3}
    if box.kind == "question":
        axes.add_patch(Polygon([(x - half, y), (x, y + high), (x + half, y), (x, y - high)], facecolor="#FFF3D1", **look))
    else:
        rounding = high - 0.01 if box.kind == "end" else 0.06
        width = 0.7 if box.kind == "end" else half
        corner, face = (x - width, y - high), "#DDEBF5" if box.kind == "end" else "white"
        axes.add_patch(
            FancyBboxPatch(corner, 2 * width, 2 * high, f"round,pad=0,rounding_size={rounding}", facecolor=face, **look)
        )
    axes.text(x, y, box.text, ha="center", va="center", fontsize=8, linespacing=1.35, zorder=4)


def _draw_arrow(axes: Axes, a: Box, b: Box, arrow: Arrow) -> None:
    (ax, ay), (bx, by), half = a.centre, b.centre, WIDE / 2
    if arrow.side == "":
        path = [(ax, ay - a.height / 2), (bx, by + b.height / 2)]
        label = (ax + 0.12, ay - a.height / 2 - 0.14)
    elif arrow.side == "across":
        column = (ax + half + bx - half) / 2
        path = [(ax + half, ay), (column, ay), (column, by), (bx - half, by)]
        label = (ax + half + 0.08, ay + 0.12)
    elif arrow.side == "back":
        column, low = bx - half - 0.95, ay - a.height / 2 - 0.3
        path = [(ax, ay - a.height / 2), (ax, low), (column, low), (column, by + 0.12), (bx - half, by + 0.12)]
        label = (0.0, 0.0)
    else:
        sign = 1 if arrow.side == "right" else -1
        column = max(sign * ax, sign * bx) * sign + sign * (half + 0.5)
        path = [(ax + sign * half, ay), (column, ay), (column, by), (bx + sign * half, by)]
        label = (ax + sign * (half + 0.12) - (0.0 if sign > 0 else 0.22), ay + 0.12)
    axes.plot(*zip(*path), color=style.INK, linewidth=1.1, zorder=2, solid_joinstyle="miter")
    head = {"arrowstyle": "-|>", "color": style.INK, "linewidth": 1.1, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", path[-1], path[-2], arrowprops=head)
    if arrow.label:
        axes.text(*label, arrow.label, fontsize=8, color=style.BLUE, fontweight="bold", zorder=5)
