"""Loads and saves map files; the suffix of the file's name determines the format."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from os import PathLike
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np

from antway import checks
from antway.errors import BadMap, BadParameter
from antway.grid import Grid
from antway.maps import image, movingai, ros, text
from antway.maps.image import GreyTrapWarning
from antway.maps.limits import DEFAULT, Limits, as_path
from antway.maps.movingai import ScenRow, load_scen
from antway.maps.ros import load_costs
from antway.scenes import shipped
from antway.tables import SHIPPED_SCENES, names

__all__ = ["GreyTrapWarning", "Limits", "ResolutionWarning", "ScenRow", "load_costs", "load_map", "load_scen", "save_map"]

PICTURES = (".png", ".pgm")  # formats that do not store the resolution, although their users have one in mind
_DRAWN = (*PICTURES, ".txt", ".map")  # formats that look like the map, with the first line on top
_FORMATS: dict[str, tuple[Callable[[Path, Limits], Grid], Callable[[Grid, Path], None]]] = {  # what reads and writes them
    ".yaml": (ros.read, ros.write),
    ".yml": (ros.read, ros.write),
    ".pgm": (image.read, image.write_pgm),
    ".png": (image.read, image.write_png),
    ".map": (movingai.read, movingai.write),
    ".txt": (text.read, text.write),
    ".npy": (image.read_npy, image.write_npy),
}


class ResolutionWarning(UserWarning):
    """A picture was loaded as a map without a resolution; its pixels are assumed to be 1 m wide."""


def load_map(
    path: str | PathLike[str],
    *,
    resolution: float | None = None,
    origin: tuple[float, float, float] | None = None,
    occupied: int | None = None,
    limits: Limits = DEFAULT,
) -> Grid:
    """Load a map: ROS `.yaml` with its picture, bare `.png` and `.pgm`, MovingAI `.map`, characters in `.txt`, or `.npy`.

    Parameters
    ----------
    path : str or path
        The file, or the name of a shipped scene such as "office" for its map. Row 0 of the grid is the last line of a ROS map
        (lowest y) and the first line of any other map. Figures and pages show a picture, `.txt` or `.map` as drawn, with row 0
        on top and y down (`Grid.top_first`), and any other map with y up; `replace(grid, top_first=False)` changes that.
    resolution : float, optional
        Edge of a cell in m, for formats that do not store it; default 1, with a warning for pictures.
    origin : (x, y, yaw), optional
        Pose of the outer corner of cell (0, 0) in m, m, rad, for formats that do not store it; default (0, 0, 0).
    occupied : int, optional
        Threshold from which a cell is blocked, 1 to 100. For a ROS map it is a cost, default 100; maps of mode `scale` and
        `raw` have costs between 0 (free) and 100 (occupied). For a picture it is the blackness of a pixel in %, default 50.
    limits : Limits
        How large the map may be.

    Returns
    -------
    Grid
        For which cells are blocked, see `antway.maps.ros`, `image`, `movingai` and `text`.

    Raises
    ------
    BadMap
        For a file that cannot be read as a map; it names the file, the part and what is allowed.
    TooLarge
        For a map beyond `limits`, before memory is allocated for it.
    BadParameter
        For a resolution, origin or threshold out of range, or a resolution or origin for a ROS map, which has its own.

    Warns
    -----
    GreyTrapWarning
        If unknown cells of a ROS map load as free, or a picture has no greys but 0 and 1, so that every cell is blocked.
    ResolutionWarning
        If a picture is loaded without a resolution; a pixel is then 1 m wide.
    """
    file = shipped(path, map_file=True) or as_path(path)
    if not file.suffix and not isfile(file):
        allowed = f"a map's file ({', '.join(_FORMATS)}), or a shipped scene: {names(SHIPPED_SCENES)}"
        raise BadMap("map", str(file), allowed, where=str(file))
    kind = checks.choice("suffix", file.suffix.lower(), _FORMATS, error=BadMap, where=str(file))
    checks.instance("limits", limits, Limits)
    if occupied is not None:
        checks.integer("occupied", occupied, low=1, high=100)
    given: dict[str, Any] = {name: one for name, one in (("resolution", resolution), ("origin", origin)) if one is not None}
    if kind in (".yaml", ".yml"):
        for name, value in given.items():
            raise BadParameter(name, value, "left out for a ROS map, which holds its own")
        return ros.read(file, limits, 100 if occupied is None else occupied)
    if occupied is not None and kind not in PICTURES:
        raise BadParameter("occupied", occupied, f"left out: {kind} has no shades")
    place = Grid(np.zeros((1, 1), dtype=np.bool_), **given)
    grid = _FORMATS[kind][0](file, limits) if occupied is None else image.read(file, limits, occupied)
    if resolution is None and kind in PICTURES:
        rows, cols = grid.shape
        warnings.warn(
            f"{file}: a picture does not say how large its pixels are; taken as 1 m each, the map is {cols} m x {rows} m "
            "(give resolution)",
            ResolutionWarning,
            stacklevel=2,
        )
    return replace(grid, resolution=place.resolution, origin=place.origin, top_first=kind in _DRAWN)


def files_of(path: str | PathLike[str]) -> tuple[Path, ...]:
    """Return the files that `load_map` reads: that of the map and, for a ROS map, that of its picture, which it must name."""
    file = shipped(path, map_file=True) or as_path(path)
    return (file, ros.picture(file)) if file.suffix.lower() in (".yaml", ".yml") else (file,)


def save_map(grid: Grid, path: str | PathLike[str]) -> None:
    """Save `grid` in the format of the suffix, so that `load_map` gives it back; a ROS `.yaml` gets a PGM beside it.

    Only ROS maps store resolution, origin and unknown cells; the other formats refuse a grid with any of these.

    Parameters
    ----------
    grid : Grid
    path : str or path
        Ends in .yaml, .yml, .pgm, .png, .map, .txt or .npy.

    Raises
    ------
    BadParameter
        For a grid that the format cannot store.
    BadMap
        For another suffix, or a file that cannot be written.
    """
    checks.instance("grid", grid, Grid)
    file = as_path(path)
    kind = checks.choice("suffix", file.suffix.lower(), _FORMATS, error=BadMap, where=str(file))
    if kind not in (".yaml", ".yml"):
        text.bare(grid, kind)
    try:
        _FORMATS[kind][1](grid, file)
    except (OSError, ValueError) as fault:
        reason = getattr(fault, "strerror", None) or fault
        raise BadMap("file", file.name, f"a file that can be written ({reason})", where=str(file)) from None
