"""Files that the live page opens and saves: maps, scenarios, traces, replay pages. Names and sizes are bounded."""

from __future__ import annotations

import base64
import io
import re
import struct
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from antway import checks
from antway.errors import BadInput, BadMap, BadParameter, TooLarge
from antway.grid import Grid
from antway.maps import PICTURES, GreyTrapWarning, Limits, ResolutionWarning, load_map
from antway.world.policy import RobotSpec
from antway.world.scenario import Scenario, load_scenario, save_scenario
from antway.world.trace import Trace
from antway.world.tracefile import to_json
from antway.world.world import World

MAX_BYTES = 4 * 2**20  # limit of all files together, as they are sent
MAX_UNPACKED = 16 * 2**20  # limit of all files together, unpacked
MAX_FILES = 8
MAX_OBSTACLES = 200
MAX_LINK = 30_000  # limit of characters of a link
EXPORTS = ("trace", "replay", "gif")
MAX_CELLS = 2**20  # of a map
LIMITS = Limits(cells=MAX_CELLS, file_bytes=MAX_BYTES)
_PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # other methods may need gigabytes of memory to unpack
_SPOILT = (zipfile.BadZipFile, zlib.error, struct.error, NotImplementedError, RuntimeError, EOFError, OSError, ValueError)
_NAME = re.compile(r"[^\W_][\w .()+-]{0,99}")
_MAPS = (".yaml", ".yml", ".map", ".txt", ".npy", ".png", ".pgm")


def read_upload(files: object) -> Scenario:
    """Return the scenario in `files`, or one made from a map in them.

    `files` is a list of {name, data in base64}; a picture also has a resolution, and the blackness from which it shows walls.

    A .zip is unpacked. The first file of type .toml, .yaml, .yml, .map, .txt, .npy, .png, .pgm, in this order, is read; the
    others are files that it refers to.

    Raises
    ------
    BadInput
        If there are too many files, they are too large, or contain no scenario or map; files are named without folder.
    """
    contents = _unpacked(decoded(files))
    given: dict[str, Any] = {}
    for file in files:  # type: ignore[attr-defined]
        if "resolution" in file:
            given["resolution"] = checks.number("resolution", file["resolution"], low=1e-6, high=1e6, unit="m")
        if "occupied" in file:
            given["occupied"] = checks.integer("occupied", file["occupied"], low=1, high=100)
    with tempfile.TemporaryDirectory(prefix="antway-") as name:
        folder = Path(name)
        for file, data in contents.items():
            (folder / file).write_bytes(data)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", GreyTrapWarning)
                warnings.simplefilter("ignore", ResolutionWarning)
                return _read(folder, list(contents), given)
        except BadInput as error:
            where = error.where.replace(f"{folder}/", "")
            value = error.value.replace(f"{folder}/", "") if isinstance(error.value, str) else error.value
            allowed = error.allowed.partition(" (limits=")[0]  # advice for Python
            if error.field.endswith(("map", "file")) and isinstance(value, str) and value not in contents:
                allowed = "selected as well: a scenario, its map and the map's picture together, or a .zip"
            raise type(error)(error.field, value, allowed, where=where) from None


def _read(folder: Path, names: list[str], given: dict[str, Any]) -> Scenario:
    for suffix in (".toml", *_MAPS):
        for name in names:
            if name.lower().endswith(suffix):
                if suffix != ".toml":
                    picture = given if suffix in PICTURES else {}
                    return task_on(load_map(folder / name, limits=LIMITS, **picture).turned(), Path(name).stem)
                scenario = load_scenario(folder / name)
                LIMITS.check_shape(*scenario.world.grid.shape, Path(name))
                return scenario
    raise BadParameter("files", names, f"a scenario .toml or a map {', '.join(_MAPS)}, and what it refers to, or a .zip")


def decoded(files: object) -> dict[str, bytes]:
    """Return the content of each file by name, from a list of {name, data in base64}."""
    if not isinstance(files, list) or not 1 <= len(files) <= MAX_FILES:
        raise BadParameter("files", files, f"1 to {MAX_FILES} files")
    contents: dict[str, bytes] = {}
    for i, file in enumerate(files):
        if not isinstance(file, dict) or not isinstance(file.get("data"), str):
            raise BadParameter(f"files[{i}]", file, "a name and data")
        try:
            contents[_name(file.get("name"))] = base64.b64decode(file["data"], validate=True)
        except ValueError as error:  # such as binascii.Error, or letters beyond ASCII
            raise BadParameter(f"files[{i}].data", str(error), "base64") from None
    _total(sum(map(len, contents.values())), MAX_BYTES)
    return contents


def _unpacked(contents: dict[str, bytes]) -> dict[str, bytes]:
    """Return the files with those inside a .zip in its place."""
    out: dict[str, bytes] = {}
    for name, data in contents.items():
        if not name.lower().endswith(".zip"):
            out[name] = data
            continue
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                entries = archive.infolist()
                if len(entries) > MAX_FILES:
                    raise TooLarge("files.length", len(entries), f"at most {MAX_FILES}", where=name)
                _total(sum(map(len, out.values())) + sum(entry.file_size for entry in entries), MAX_UNPACKED)
                for entry in entries:
                    if entry.compress_type not in _PLAIN:
                        raise BadParameter("zip", f"method {entry.compress_type}", "stored or deflated", where=name)
                    with archive.open(entry) as file:
                        out[_name(entry.filename)] = file.read(MAX_UNPACKED)
        except BadInput:
            raise
        except _SPOILT as error:
            raise BadParameter("zip", str(error), "a zip archive", where=name) from None
    _total(sum(map(len, out.values())), MAX_UNPACKED)
    return out


def _total(size: int, most: int, field: str = "files") -> None:
    if size > most:
        raise TooLarge(field, f"{size} bytes", f"at most {most} bytes together")


def _name(value: object) -> str:
    if not isinstance(value, str) or not _NAME.fullmatch(value):
        raise BadParameter("name", value, "a file's name of at most 100 letters, digits, spaces and _ . ( ) + -")
    return value


def task_on(grid: Grid, name: str) -> Scenario:
    """Return a scenario across the largest connected part of `grid` for the robot, from low row and column to high."""
    from scipy.ndimage import label

    robot = RobotSpec(radius=0.3 if grid.resolution >= 1.0 else 0.25)
    free = ~grid.inflate(robot.radius).blocked
    parts, count = label(free)
    if count == 0:
        raise BadMap("map", name, f"one on which a robot of {robot.radius:g} m radius can stand")
    cells = np.argwhere(parts == np.argmax(np.bincount(parts.ravel())[1:]) + 1)
    rank = cells.sum(axis=1)
    start, goal = (grid.centre((int(r), int(c))) for r, c in (cells[np.argmin(rank)], cells[np.argmax(rank)]))
    return Scenario(World(grid), start=start, goal=goal, robot=robot, horizon=600.0, name=name)


def as_file(name: str, type: str, data: str | bytes) -> dict[str, Any]:
    """Return the message by which the page saves a file."""
    content = {"text": data} if isinstance(data, str) else {"base64": base64.b64encode(data).decode()}
    return {"kind": "file", "name": name, "type": type, **content}


def _zipped(scenario: Scenario) -> bytes:
    """Return a zip of the scenario's TOML and its map, which `read_upload` reads back; if that would refuse it: `TooLarge`."""
    buffer = io.BytesIO()
    with tempfile.TemporaryDirectory(prefix="antway-") as name, zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        save_scenario(scenario, Path(name) / "scenario.toml")
        files = sorted(Path(name).iterdir())
        _total(sum(file.stat().st_size for file in files), MAX_UNPACKED, "scenario")
        for file in files:
            archive.write(file, file.name)
    _total(len(buffer.getvalue()), MAX_BYTES, "scenario")
    return buffer.getvalue()


def exported_scenario(what: str, scenario: Scenario, policies: Sequence[str]) -> dict[str, Any]:
    """Return the message with a scenario as a .zip file, which `read_upload` reads back.

    `what` is "scenario" for a file to save, "keep" for one that the page keeps in the browser, or "link" for the part after the
    # of an address that opens the scenario; that contains the file and is sent to no server. If it is too long for browsers,
    it is `TooLarge`.
    """
    packed = _zipped(scenario)
    if what == "scenario":
        return as_file(f"{stem(scenario.name)}.zip", "application/zip", packed)
    if what == "keep":
        return {"kind": "kept", "name": scenario.name, "policies": policies, "data": base64.b64encode(packed).decode()}
    data = base64.urlsafe_b64encode(packed).decode().rstrip("=")
    if len(data) > MAX_LINK:
        raise TooLarge("link", f"{len(data)} characters", f"at most {MAX_LINK}; save the scenario as a file instead")
    return {"kind": "link", "hash": f"policies={','.join(policies)}&open={data}"}


def exported(what: str, trace: Trace, *beside: Trace) -> dict[str, Any]:
    """Return a trace, or the replay page or animation of it and those `beside` it (`what` is one of `EXPORTS`), as a file."""
    from antway.view.animation import write_animation
    from antway.view.figures import global_path
    from antway.view.replay import replay_page

    name = "-".join((stem(trace.scenario), trace.policy, *(other.policy for other in beside)))
    if what == "trace":
        return as_file(f"{name}.json", "application/json", to_json(trace))
    path = global_path(trace)
    if what == "replay":
        return as_file(f"{name}.html", "text/html", replay_page(trace, beside=beside, shortest=path))
    with tempfile.TemporaryDirectory(prefix="antway-") as folder:
        data = write_animation(trace, Path(folder) / "run.gif", beside=beside, shortest=path).read_bytes()
    return as_file(f"{name}.gif", "image/gif", data)


def stem(name: str) -> str:
    """Return a file's name, without suffix, for something of this name."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", name)[:60].strip("-") or "scenario"
