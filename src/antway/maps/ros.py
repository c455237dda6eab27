"""Maps of ROS: a YAML description of a PGM or PNG, read as by Nav2's map_server.

The last line of the picture is row 0. The occupancy is o = 1 - grey / 255 (grey / 255 with `negate`), in single precision. In
trinary mode the cost is 0 where o <= free_thresh, else 100 where o >= occupied_thresh, else -1 (unknown). Scale mode differs
between the thresholds, where the cost goes from 0 to 100. In raw mode a grey of 0 to 100 is the cost, and any other is -1.
Where the picture is not opaque, trinary and scale give -1. A cell is blocked at cost 100, the lethal cost, or -1.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadInput, BadMap, BadParameter
from antway.grid import Grid
from antway.maps.image import GreyTrapWarning, pgm, read_grey
from antway.maps.limits import DEFAULT, Limits, as_path
from antway.reading import check_yaml, opened

UNKNOWN_GREY, FREE_GREY = 205, 254  # the greys that map_saver writes
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", re.ASCII)
_FLAG = {"0": False, "1": True, "false": False, "true": True, "no": False, "yes": True, "off": False, "on": True}


@dataclass(frozen=True, slots=True)
class _Description:
    image: Path
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: str


def read(path: Path, limits: Limits, occupied: int = 100) -> Grid:
    """Read the ROS map described by `path`. See above for which cells are blocked, with `occupied` in place of 100."""
    about = _describe(path, limits)
    costs = _costs(about, path, limits, 4)
    unknown = costs == -1
    try:
        return Grid((costs >= occupied) | unknown, about.resolution, about.origin, unknown if unknown.any() else None)
    except BadInput as wrong:
        raise wrong.at(str(path)) from None


def picture(path: Path) -> Path:
    """Return the file of the picture of the ROS map described by `path`."""
    return _describe(path, DEFAULT).image


def load_costs(path: str | PathLike[str], *, limits: Limits = DEFAULT) -> NDArray[np.int8]:
    """Load the costs of a ROS map, read-only int8[H, W]: 0 free to 100 lethal, -1 unknown; row 0 has the lowest y.

    Raises
    ------
    BadMap, BadParameter, TooLarge
        As for `load_map`.
    """
    path = as_path(path)
    checks.instance("limits", limits, Limits)
    return _costs(_describe(path, limits), path, limits, 3)


def _costs(about: _Description, path: Path, limits: Limits, level: int) -> NDArray[np.int8]:
    """Return the costs of a map; its caller, whom a warning names, is `level` calls up."""
    grey, clear = read_grey(about.image, limits)
    table = _cost_of_grey(about)
    costs = table[grey]
    if clear is not None and about.mode != "raw":
        costs[clear] = -1
    if table[UNKNOWN_GREY] == 0 and not about.negate:
        trapped = int(np.count_nonzero((grey == UNKNOWN_GREY) & (costs == 0)))
        if trapped:
            why = f"free_thresh is {about.free_thresh:g}; set free_thresh to 0.196 (anything below 0.19607)"
            if about.mode == "scale":
                why = "in mode scale only transparent pixels are unknown; set mode to trinary and free_thresh to 0.196"
            warnings.warn(
                f"{path}: {trapped} cells have grey {UNKNOWN_GREY}, written by map_saver for unknown, but load as free because "
                f"{why} to keep them unknown",
                GreyTrapWarning,
                stacklevel=level,
            )
    costs = np.ascontiguousarray(costs[::-1])
    costs.flags.writeable = False
    return costs


def _cost_of_grey(about: _Description) -> NDArray[np.int8]:
    """Return the cost of each grey value, int8[256]; single precision throughout, as in map_server."""
    grey = np.arange(256)
    if about.mode == "raw":
        return np.where(grey <= 100, grey, -1).astype(np.int8)
    shade = grey.astype(np.float32) / np.float32(255)
    occupancy = shade if about.negate else np.float32(1) - shade
    low, high = np.float32(about.free_thresh), np.float32(about.occupied_thresh)
    between = np.full(256, -1.0, dtype=np.float32)
    if about.mode == "scale" and high > low:
        share = (occupancy - low) / np.float32(about.occupied_thresh - about.free_thresh) * np.float32(100)
        between = np.floor(np.clip(share, 0, 100) + np.float32(0.5))
    return np.select([occupancy <= low, occupancy >= high], [0.0, 100.0], between).astype(np.int8)


def _describe(path: Path, limits: Limits) -> _Description:
    where = str(path)
    with opened(path, limits.yaml_bytes) as (file, _):
        fields = _fields(file.read(), where, limits)

    def number(name: str, low: float, high: float) -> float:
        return _number(name, _need(fields, name, where), low, high, where)

    origin = _need(fields, "origin", where)
    if not isinstance(origin, list) or len(origin) != 3:
        raise BadParameter("origin", origin, "three numbers [x, y, yaw] (m, m, rad)", where=where)
    x, y, yaw = (_number(f"origin[{i}]", part, -1e9, 1e9, where) for i, part in enumerate(origin))
    negate = _need(fields, "negate", where)
    if not isinstance(negate, str) or negate.lower() not in _FLAG:
        raise BadParameter("negate", negate, "0 or 1", where=where)
    mode = fields.get("mode", "trinary")
    occupied, free = number("occupied_thresh", 0.0, 1.0), number("free_thresh", 0.0, 1.0)
    if free > occupied:
        raise BadParameter("free_thresh", free, f"at most occupied_thresh, {occupied:g}", where=where)
    return _Description(
        image=_beside(path, _need(fields, "image", where)),
        resolution=number("resolution", 1e-6, 1e6),
        origin=(x, y, yaw),
        negate=_FLAG[negate.lower()],
        occupied_thresh=occupied,
        free_thresh=free,
        mode=checks.choice("mode", mode.lower() if isinstance(mode, str) else mode, ("trinary", "scale", "raw"), where=where),
    )


def _fields(data: bytes, where: str, limits: Limits) -> dict[str, object]:
    """Read the top level of a YAML mapping as texts, lists of texts, or None for anything else; makes no objects."""
    check_yaml(data, where, events=limits.yaml_events, depth=limits.yaml_depth, aliases=limits.yaml_aliases)
    try:
        top = yaml.compose(data, Loader=yaml.SafeLoader)
    except (yaml.YAMLError, OverflowError, ValueError) as fault:  # such as two documents, or an undefined reference
        raise BadMap("YAML", str(fault), "well-formed", where=where) from None
    if not isinstance(top, yaml.MappingNode):
        raise BadMap("YAML", data[:40], "a mapping with image, resolution, origin and so on", where=where)
    fields: dict[str, object] = {}
    for key, value in top.value:
        field = _plain(key)
        if field in fields:
            raise BadMap(str(field), _plain(value), "given once", where=where)
        if field is not None:
            fields[field] = [_plain(v) for v in value.value] if isinstance(value, yaml.SequenceNode) else _plain(value)
    return fields


def _plain(node: yaml.Node) -> str | None:
    return str(node.value) if isinstance(node, yaml.ScalarNode) else None


def _need(fields: dict[str, object], name: str, where: str) -> object:
    if name not in fields:
        raise BadMap(name, None, "given", where=where)
    return fields[name]


def _number(name: str, value: object, low: float, high: float, where: str) -> float:
    if not isinstance(value, str) or _NUMBER.fullmatch(value) is None:
        raise BadParameter(name, value, "a number", where=where)
    return checks.number(
        name, float(value.lower().replace(".inf", "inf").replace(".nan", "nan")), low=low, high=high, where=where
    )


def _beside(path: Path, image: object) -> Path:
    """Return the path of `image`, which must be in the folder of the description `path` after links are resolved.

    It may be absolute, as `map_saver -f /folder/map` of ROS 1 writes it.
    """
    try:
        target = (path.parent / str(image)).resolve()
        inside = any(target.is_relative_to(home) for home in (path.parent.resolve(), path.resolve().parent))
    except (OSError, RuntimeError, ValueError):  # such as a link to itself, or an invalid name
        inside = False
    if not inside or not isinstance(image, str):
        raise BadMap("image", image, "a file in the folder of the YAML or below, not a link out of it", where=str(path))
    return target


def write(grid: Grid, path: Path) -> None:
    """Write `path` and a PGM of the same name: trinary, with the greys of map_saver. Nothing of the grid is lost."""
    grey = np.where(grid.blocked, 0, FREE_GREY).astype(np.uint8)
    if grid.unknown is not None:
        grey[grid.unknown] = UNKNOWN_GREY
    image = path.with_suffix(".pgm")
    about = {
        "image": image.name,
        "mode": "trinary",
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    image.write_bytes(pgm(grey[::-1]))
    path.write_text(yaml.safe_dump(about, sort_keys=False, default_flow_style=None, allow_unicode=True), encoding="utf-8")
