"""Pictures: figures, animations and replay pages of plans and episodes."""

from __future__ import annotations

from pathlib import Path

from antway import checks
from antway.errors import BadParameter
from antway.writing import PICTURES, VIEWS, check_target


def write_view(trace_file: str | Path, out: str | Path, *, at: float | None = None) -> Path:
    """Convert a trace file to the format of the suffix of `out`, and return its path.

    Parameters
    ----------
    trace_file : path
        As `Trace.save` writes it.
    out : path
        .html for a replay page, .gif or .mp4 for an animation, .png, .svg or .pdf for a picture.
    at : float or None
        For a picture, the time to show in s; None: the whole driven path.

    Raises
    ------
    BadScenario, TooLarge
        For a file that is not a trace.
    BadParameter
        For another suffix, `at` with anything but a picture, and if the file cannot be written.
    """
    from antway.view import figures
    from antway.view.animation import write_animation
    from antway.view.replay import write_replay
    from antway.world.trace import Trace

    out = check_target("out", out, VIEWS)
    if at is not None and out.suffix.lower() not in PICTURES:
        raise BadParameter("at", at, f"left out, except for a picture ({', '.join(PICTURES)})")
    trace = Trace.load(trace_file)
    path = figures.global_path(trace)
    if out.suffix.lower() == ".html":
        return write_replay(trace, out, shortest=path)
    if out.suffix.lower() in (".gif", ".mp4"):
        return write_animation(trace, out, shortest=path)
    if at is None:
        return figures.save(figures.final_figure(trace, path=path), out)
    at = checks.number("at", at, low=0.0, high=float(trace.t[-1]), unit="s")
    step = int((trace.t <= at + 1e-9).sum()) - 1
    return figures.save(figures.moment_figure(trace, step, title=trace.scenario, path=path, pheromone=True), out)
