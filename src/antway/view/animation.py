"""An episode as an animated GIF, or as MP4 where ffmpeg is installed. Frames are drawn by Pillow, antialiased."""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from antway import checks
from antway.errors import BadParameter
from antway.planning import Plan
from antway.view import style
from antway.view.figures import HORIZON, predicted
from antway.view.pages import faint_scale
from antway.world.trace import Trace
from antway.writing import writing

SUPER = 2  # factor by which frames are drawn larger and then reduced, to smooth edges
LONGEST = 12.0  # s; longer episodes are shown faster
_LEAST = 0.02  # s; each frame is shown for at least this time
TALLEST = 640  # px; greatest height of the map
CAPTION = 34  # px; height of the caption under the map
LEGEND = 24  # px; height of a line of the legend
NARROWEST, LOWEST = 160, 40  # px; a narrower or lower map stands in the middle of a picture of this size
GAP = 4  # px; gap between episodes side by side
ROBOT, HALO = 5.0, 5.0  # px; least radius of the robot, and width of the ring around it that makes it easy to find

XY = Sequence[float] | NDArray[np.float64]


def write_animation(
    trace: Trace,
    path: str | Path,
    *,
    beside: Sequence[Trace] = (),
    shortest: Plan | None = None,
    width: int = 480,
    frames: int = 100,
) -> Path:
    """Write `trace` as an animation of at most `frames` frames and at most 12 s; return its path.

    Episodes `beside` it, of the same scene, are shown to its right at the same times, each `width` pixels wide.

    Raises
    ------
    BadParameter
        For a suffix other than .gif and .mp4, for .mp4 if ffmpeg is not installed, if the file cannot be written, and for a
        number of pixels or frames below 1.
    """
    width, frames = (checks.integer(name, value, low=1) for name, value in (("width", width), ("frames", frames)))
    traces = (trace, *beside)
    longest = max(traces, key=lambda one: float(one.t[-1]))
    times = longest.t[np.unique(np.linspace(0, len(longest), frames).round().astype(int))]
    pause = max(min(LONGEST, float(times[-1])) / len(times), _LEAST)
    pictures = _frames(traces, times, shortest, width)
    with writing("out", path) as file:
        if file.suffix.lower() == ".gif":
            _write_gif(list(pictures), file, round(1000 * pause))
        elif file.suffix.lower() == ".mp4" and shutil.which("ffmpeg"):
            _write_mp4(pictures, file, 1 / pause)
        else:
            raise BadParameter("out", file.name, "a file name that ends in .gif (or .mp4, if ffmpeg is installed)")
    return file


def _write_gif(pictures: list[Image.Image], path: Path, pause: int) -> None:
    """Write a GIF with one palette for all frames, so that colours do not flicker and only changes are stored."""
    palette = pictures[len(pictures) // 2].quantize(96, method=Image.Quantize.MEDIANCUT)
    first, *rest = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures)
    pauses = [pause] * len(rest) + [2000]
    first.save(path, "GIF", save_all=True, append_images=rest, duration=pauses, loop=0, optimize=False, disposal=1)


def _write_mp4(pictures: Iterator[Image.Image], path: Path, rate: float) -> None:
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "image2pipe", "-r", f"{rate:.3f}", "-c:v", "bmp", "-i", "-"]
    command += ["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0", "-pix_fmt", "yuv420p", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        assert process.stdin is not None
        for picture in pictures:
            picture.save(process.stdin, "BMP")
    if process.returncode:
        raise OSError(f"ffmpeg failed with status {process.returncode} on {path}")


class _Painter:
    """Draws an episode in metres on enlarged pictures, over the same backdrop: map, start, and the path `shortest`."""

    def __init__(self, trace: Trace, width: int, shortest: Plan | None) -> None:
        self.trace = trace
        rows, cols = trace.task.grid.shape
        wide, high = width, max(1, round(width * rows / cols))
        self.scale = width * SUPER / (cols * trace.task.grid.resolution)
        if high > TALLEST:
            wide, high = max(1, round(TALLEST * cols / rows)), TALLEST
            self.scale = TALLEST * SUPER / (rows * trace.task.grid.resolution)
        self.map_size = (wide * SUPER, high * SUPER)
        self.width, self.height = max(wide, min(NARROWEST, width)), max(high, LOWEST)
        self.left, self.top = (self.width - wide) // 2 * SUPER, (self.height - high) // 2 * SUPER
        self.x, self.y, _ = trace.task.grid.origin
        self.top_first = trace.task.grid.top_first
        self.font = ImageFont.load_default(15 * SUPER)
        self.backdrop = _backdrop(self, shortest)

    def at(self, point: XY) -> tuple[float, float]:
        y = (float(point[1]) - self.y) * self.scale
        return self.left + (float(point[0]) - self.x) * self.scale, self.top + (y if self.top_first else self.map_size[1] - y)

    def upright(self, cells: NDArray[np.generic]) -> NDArray[np.generic]:
        """Return values by cell, [H, W, ...], top line first."""
        return cells if self.top_first else np.flipud(cells)

    def disc(self, draw: ImageDraw.ImageDraw, centre: XY, radius: float, fill: str | None, edge: str) -> None:
        (x, y), r = self.at(centre), max(radius * self.scale, 3.0 * SUPER)
        draw.ellipse((x - r, y - r, x + r, y + r), fill=fill, outline=edge, width=2 * SUPER)

    def line(self, draw: ImageDraw.ImageDraw, points: NDArray[np.float64], colour: str, width: float) -> None:
        flat = [self.at(point) for point in points]
        if len(flat) < 2:
            return
        draw.line(flat, fill="white", width=round((width + 2) * SUPER), joint="curve")
        draw.line(flat, fill=colour, width=round(width * SUPER), joint="curve")

    def dashes(self, draw: ImageDraw.ImageDraw, points: NDArray[np.float64], colour: str) -> None:
        """Draw a dashed line with dashes and gaps of 6 pixels."""
        paths = np.hypot(*np.diff(points, axis=0).T)
        along = np.concatenate(([0.0], np.cumsum(paths)))
        step = 6 * SUPER / self.scale
        for k in range(0, math.ceil(along[-1] / step), 2):
            ends = np.array([k * step, min((k + 1) * step, along[-1])])
            inner = points[(along > ends[0]) & (along < ends[1])]
            a, b = np.column_stack([np.interp(ends, along, points[:, i]) for i in (0, 1)])
            draw.line([self.at(p) for p in (a, *inner, b)], fill=colour, width=round(1.3 * SUPER))


def _frames(traces: Sequence[Trace], times: NDArray[np.float64], shortest: Plan | None, width: int) -> Iterator[Image.Image]:
    painters = [_Painter(trace, width, shortest) for trace in traces]
    legend = _legend(traces, shortest is not None, sum(painter.width + GAP for painter in painters) - GAP)
    for time in times:
        steps = (int(np.searchsorted(trace.t, time + 1e-9, side="right")) - 1 for trace in traces)
        parts = [_frame(painter, step, len(painters) > 1) for painter, step in zip(painters, steps)]
        whole = Image.new("RGB", (legend.width, parts[0].height + legend.height), style.WALL)
        for k, part in enumerate(parts):
            whole.paste(part, (k * (part.width + GAP), 0))
        whole.paste(legend, (0, parts[0].height))
        yield whole


def last_moment(trace: Trace, width: int) -> Image.Image:
    """Return the end of an episode as a picture of its map, at most `width` pixels wide."""
    painter = _Painter(trace, width, None)
    return _frame(painter, len(trace), False).crop((0, 0, painter.width, painter.height))


def _legend(traces: Sequence[Trace], shortest: bool, width: int) -> Image.Image:
    """Return a legend of everything drawn in these episodes, in as many lines as needed."""
    decisions = [decision for trace in traces for _, decision in trace.decisions]
    moving = any(len(trace.obstacle_radius) for trace in traces)
    foreseen = any(decision.predicted is not None and len(decision.predicted) for decision in decisions)
    kinds = {  # name: shape, colour, and whether it is drawn
        "robot": ("robot", style.BLUE, True),
        "goal": ("star", "", True),
        "stop": ("diamond", style.ORANGE, any(trace.rounds is not None for trace in traces)),
        "driven": ("line", style.BLUE, True),
        "planned": ("line", style.TEAL, any(decision.path is not None for decision in decisions)),
        "shortest": ("dashes", style.INK, shortest),
        "obstacle": ("disc", style.RED, moving),
        "not sensed": ("ring", style.RED, moving and not all(trace.sensed.all() for trace in traces)),
        "predicted": ("area", style.ORANGE, foreseen),
        "pheromone": ("area", style.VIOLET, any(decision.pheromone is not None for decision in decisions)),
    }
    font, wide = ImageFont.load_default(12 * SUPER), width * SUPER
    places: list[tuple[float, int, str]] = []
    left, row = 8.0 * SUPER, 0
    for name, (_, _, shown) in kinds.items():
        long = 26 * SUPER + font.getlength(name)
        if shown:
            if left + long > wide and places:
                left, row = 8.0 * SUPER, row + 1
            places.append((left, row, name))
            left += long + 14 * SUPER
    picture = Image.new("RGB", (wide, (row + 1) * LEGEND * SUPER), "white")
    draw = ImageDraw.Draw(picture)
    for left, row, name in places:
        _symbol(draw, left + 10 * SUPER, (row + 0.5) * LEGEND * SUPER, *kinds[name][:2])
        draw.text((left + 26 * SUPER, (row + 0.5) * LEGEND * SUPER), name, fill=style.INK, font=font, anchor="lm")
    return picture.reduce(SUPER)


def _symbol(draw: ImageDraw.ImageDraw, x: float, y: float, shape: str, colour: str) -> None:
    """Draw the symbol of an entry of the legend."""
    r = 5 * SUPER
    if shape == "star":
        _star(draw, x, y, 7 * SUPER)
    elif shape == "diamond":
        _diamond(draw, x, y)
    elif shape in ("line", "dashes"):
        parts = [(-9, 9)] if shape == "line" else [(-9, -4), (-1, 4), (7, 10)]
        for a, b in parts:
            draw.line((x + a * SUPER, y, x + b * SUPER, y), fill=colour, width=round((3 if shape == "line" else 1.3) * SUPER))
    elif shape == "area":
        draw.rectangle((x - 9 * SUPER, y - r, x + 9 * SUPER, y + r), fill=_faded(colour))
    else:
        if shape == "robot":
            draw.ellipse((x - 1.7 * r, y - 1.7 * r, x + 1.7 * r, y + 1.7 * r), fill=_faded(colour))
        draw.ellipse((x - r, y - r, x + r, y + r), fill="white" if shape == "ring" else colour, outline=colour, width=2 * SUPER)


def _faded(colour: str) -> tuple[int, int, int]:
    """Return a colour half way to white."""
    red, green, blue = ((255 + part) // 2 for part in ImageColor.getrgb(colour))
    return red, green, blue


def _backdrop(painter: _Painter, shortest: Plan | None) -> Image.Image:
    """Return the constant part of an episode's pictures: the map, the global path, the start, the stops."""
    task = painter.trace.task
    grid = task.grid
    shade = np.full((*grid.shape, 3), 255, np.uint8)
    shade[grid.blocked] = ImageColor.getrgb(style.WALL)
    if grid.unknown is not None:
        shade[grid.unknown] = ImageColor.getrgb(style.UNKNOWN)
    size = painter.map_size
    picture = Image.new("RGB", (painter.width * SUPER, (painter.height + CAPTION) * SUPER), style.UNKNOWN)
    reduce = Image.Resampling.BOX if max(grid.shape) > max(size) else Image.Resampling.NEAREST
    picture.paste(Image.fromarray(painter.upright(shade)).resize(size, reduce), (painter.left, painter.top))
    draw = ImageDraw.Draw(picture)
    if shortest is not None and len(shortest.cells) > 1:
        painter.dashes(draw, shortest.xy(grid), style.INK)
    painter.disc(draw, task.start, 0.0, "white", style.INK)
    for stop in () if painter.trace.rounds is None else painter.trace.rounds.stops:
        _diamond(draw, *painter.at(stop.at))
    return picture


def _frame(painter: _Painter, step: int, named: bool) -> Image.Image:
    """Return the picture of an episode at a step, with a caption, which has the name of the policy if it is `named`."""
    trace, picture = painter.trace, painter.backdrop.copy()
    decision = trace.decision_at(step)
    if decision is not None and decision.pheromone is not None:
        _paste_pheromone(picture, painter, *decision.pheromone)
    _paste_predictions(picture, painter, step)
    draw = ImageDraw.Draw(picture)
    if decision is not None and decision.path is not None:
        painter.line(draw, decision.path.xy, style.TEAL, 2)
    painter.line(draw, trace.xy[: step + 1], style.BLUE, 3)
    for xy, radius, seen in zip(trace.obstacle_xy[step], trace.obstacle_radius.tolist(), trace.sensed[step]):
        painter.disc(draw, xy, radius, style.RED if seen else "white", style.RED)
    _star(draw, *painter.at(trace.task.goal), 10 * SUPER)
    _mark_robot(picture, painter, step)
    top = painter.height * SUPER
    draw.rectangle((0, top, picture.width, picture.height), fill="white")
    draw.line((0, top, picture.width, top), fill=style.WALL, width=SUPER)
    words = f"t = {trace.t[step]:4.1f} s   {decision.action.replace('-', ' ') if decision is not None else ''}"
    if named:
        ended = step == len(trace)
        words = f"{trace.policy}   {words}" if not ended else f"{trace.policy}   {trace.outcome.value} in {trace.t[step]:.1f} s"
    draw.text((10 * SUPER, top + 8 * SUPER), words, fill=style.INK, font=painter.font)
    return picture.reduce(SUPER)


def _mark_robot(picture: Image.Image, painter: _Painter, step: int) -> None:
    """Draw the robot with a line to its front, and a ring around it that makes it easy to find."""
    trace = painter.trace
    (x, y), r = painter.at(trace.xy[step]), max(trace.task.robot.radius * painter.scale, ROBOT * SUPER)
    ring, veil = r + HALO * SUPER, Image.new("L", picture.size, 0)
    ImageDraw.Draw(veil).ellipse((x - ring, y - ring, x + ring, y + ring), fill=110)
    _tint(picture, style.BLUE, veil)
    draw = ImageDraw.Draw(picture)
    draw.ellipse((x - r, y - r, x + r, y + r), fill=style.BLUE, outline="white", width=SUPER)
    heading = float(trace.heading[step])
    up = 1.0 if painter.top_first else -1.0
    draw.line((x, y, x + r * math.cos(heading), y + up * r * math.sin(heading)), fill="white", width=2 * SUPER)


def _paste_pheromone(picture: Image.Image, painter: _Painter, row: int, col: int, amount: NDArray[np.float32]) -> None:
    """Paste pheromone by cell, [H, W], whose first cell is (row, col); the more, the more opaque."""
    grid = painter.trace.task.grid
    height, width = amount.shape
    cell = grid.resolution
    left, top = painter.at((painter.x + col * cell, painter.y + (row if grid.top_first else row + height) * cell))
    size = (max(1, round(width * cell * painter.scale)), max(1, round(height * cell * painter.scale)))
    opacity = painter.upright((faint_scale(amount) * 200).astype(np.uint8))
    alpha = Image.fromarray(opacity).resize(size, Image.Resampling.NEAREST)
    picture.paste(style.VIOLET, (round(left), round(top)), alpha)


def _paste_predictions(picture: Image.Image, painter: _Painter, step: int) -> None:
    """Paste the bands that obstacles sweep according to the policy's prediction."""
    trace = painter.trace
    if not predicted(trace, step, HORIZON):
        return
    veil = Image.new("L", picture.size, 0)
    for share, strength in ((1.0, 60), (2 / 3, 95), (1 / 3, 130)):
        draw = ImageDraw.Draw(veil)
        for here, there, radius in predicted(trace, step, HORIZON * share):
            (x, y), r = painter.at(there), radius * painter.scale
            draw.ellipse((x - r, y - r, x + r, y + r), fill=strength)
            draw.line([painter.at(here), (x, y)], fill=strength, width=round(2 * r))
    _tint(picture, style.ORANGE, veil)


def _tint(picture: Image.Image, colour: str, veil: Image.Image) -> None:
    """Lay a colour over a picture as far as a veil of its size is opaque, which is a small part of it as a rule."""
    if (box := veil.getbbox()) is not None:
        picture.paste(colour, box, veil.crop(box))


def _diamond(draw: ImageDraw.ImageDraw, x: float, y: float) -> None:
    r = 5 * SUPER
    draw.polygon([(x - r, y), (x, y - r), (x + r, y), (x, y + r)], fill="white", outline=style.ORANGE, width=2 * SUPER)


def _star(draw: ImageDraw.ImageDraw, x: float, y: float, size: float) -> None:
    angles = [k * math.pi / 5 - math.pi / 2 for k in range(10)]
    corners = [(x + radius * math.cos(a), y + radius * math.sin(a)) for a, radius in zip(angles, (size, 0.42 * size) * 5)]
    draw.polygon(corners, fill=style.GOLD, outline=style.INK, width=SUPER)
