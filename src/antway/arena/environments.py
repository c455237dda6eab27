"""Suites in given environments: the shipped scenes, any map file, recorded tracks, and fields of cylinders."""

from __future__ import annotations

import io
import itertools
import math
import warnings
from collections.abc import Iterable, Iterator
from os.path import isfile
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from antway.arena.suites import Chance, Suite, content_hash
from antway.errors import BadMap, BadScenario, TooLarge
from antway.grid import Cell, Grid
from antway.limits import MAX_ORIGIN, MAX_PLACE
from antway.maps import files_of, load_map
from antway.reading import opened
from antway.scenes import SCENES, scene
from antway.search.distance_field import distance_field
from antway.world.line_of_sight import passes
from antway.world.motions import Bounce, Replay, Waypoints, place_at
from antway.world.policy import XY, RobotSpec
from antway.world.scenario import Scenario, load_scenario
from antway.world.sensor import Sensor
from antway.world.world import Obstacle, World

ROBOT = RobotSpec(radius=0.3, v_max=1.0, dt=0.1, sensor_range=4.0)
DENSITIES = {"low": 0.02, "medium": 0.05, "high": 0.1}  # 1/m^2; discs per area of free space
MOST = 300  # limit of discs in an episode
MAX_BYTES = 64 * 2**20  # limit of a track file
MAX_ROWS = 2_000_000  # limit of rows read from a track file, and half of that of its lines
MAX_LINE = 10_000  # limit of the letters of a line
_COLUMNS = "t", "id", "x", "y"  # columns of a recording in CSV
_GAP = 3.0  # s; who is unseen for longer, and for longer than 3 frames, counts as somebody else from then on
_STEP = 0.1  # s; of places less than this apart one is used, because errors of places are most of a velocity between them
_LONGER = 0.4  # s; where steps are shorter than `_STEP`, people come and go with the velocity over this time
_DRAWS = 30  # limit of starts that are drawn for an episode at each of these distances from people:
_CLEAR = (1.5, 0.8)  # m; the second is for crowds


def paper() -> Suite:
    """Return the shipped scenes, whose obstacles draw new speeds and phases in every episode."""
    loaded = {name: load_scenario(scene(name)) for name in SCENES}
    return Suite("paper", SCENES, lambda group, chance: loaded[group])


def maps(file: str) -> Suite:
    """Return discs that bounce about on the map in `file`, and a robot that crosses its largest connected part."""
    grid = load_map(file).turned()
    inflated = grid.inflate(ROBOT.radius + grid.resolution)
    rooms, _ = scipy.ndimage.label(~inflated.blocked)
    sizes = np.bincount(rooms[~inflated.blocked], minlength=2)
    free = np.argwhere(rooms == int(np.argmax(sizes[1:])) + 1)
    if len(free) < 100:
        raise BadMap("map", file, f"one with a room of at least 100 cells for a robot of {ROBOT.radius:g} m")
    clearance = grid.clearance()

    def make(group: str, chance: Chance) -> Scenario:
        start = _pick(chance, free)
        field = distance_field(inflated, start)
        far = float(field[np.isfinite(field)].max())
        goal = _pick(chance, np.argwhere(np.isfinite(field) & (field > far / 2)))
        area = float((~grid.blocked).sum()) * grid.resolution**2
        obstacles: list[Obstacle] = []
        wanted, here = min(max(round(DENSITIES[group] * area), 1), MOST), grid.centre(start)
        for _ in range(100 * wanted):
            radius, cell = chance.between(0.2, 0.4), _pick(chance, free)
            at = grid.centre(cell)
            if clearance[cell] > radius and math.dist(at, here) > radius + ROBOT.radius + 1.0:
                obstacles.append(Obstacle(radius, Bounce(at, chance.between(0.3, 0.9), chance.turn())))
            if len(obstacles) == wanted:
                break
        return Scenario(
            World(grid, tuple(obstacles)),
            here,
            grid.centre(goal),
            robot=ROBOT,
            horizon=60.0 + 3.0 * far / ROBOT.v_max,
            obstacle_speed=0.9,
            obstacle_surge=0.5,
            name=f"{Path(file).name} {group}",
        )

    files = files_of(file)
    return Suite(f"maps:{files[0].name}-{content_hash(*files)}", tuple(DENSITIES), make, default=20)


def tracks(file: str) -> Suite:
    """Return recorded pedestrians and a robot that crosses the area in which they walked; they do not see it.

    `file` is an ETH/UCY `obsmat.txt` (columns frame, id, x, z, y and velocities; frames 0.4 s apart), the same with only frame,
    id, x and y, or CSV lines t,id,x,y (s, m). Each episode starts at a random time of the record. The start is near a random
    side of the area, the goal near the opposite one, and nobody is within 1.5 m of the start at that time, or 0.8 m in crowds,
    where 30 draws find no such start. The horizon is 60 s, or 2 s for each metre between both ends where that is longer. It is
    longer for a slower robot, and people whose records begin later come then, too, unless they would walk in so slowly that
    they are near the start at that time.

    People do not appear from nowhere: before their records start they walk in straight with the velocity of the first step, and
    after the end they walk on with the velocity of the last step, or of 0.4 s where steps are shorter than 0.1 s. Of places
    less than 0.1 s apart, as those of cameras, one in 0.1 s or more is used and the last. If a record starts during the episode
    within 1 m of the robot (between centres, at the next control period), that person is absent until the end of a control
    period at which the distance exceeds 1 m plus the distance that the robot can drive in it. The robot knows nothing about the
    speeds in the record: the declared bound is the usual 1.5 m/s, which some people exceed.
    """
    table = read_tracks(file)
    low, high = table[:, 2:].min(axis=0) - 2.0, table[:, 2:].max(axis=0) + 2.0
    cell = 0.2
    shape = np.ceil((high - low) / cell).astype(int)
    if shape.max() > 2000:
        raise TooLarge("tracks", tuple((high - low).tolist()), "a place of at most 400 m a side; x and y are in m", where=file)
    grid = Grid(np.zeros((shape[1], shape[0]), np.bool_), cell, (float(low[0]), float(low[1]), 0.0))
    walkers = walks(table, file)
    last, name, far = float(table[:, 0].max()), Path(file).name, float(np.hypot(*(high - low)))

    def make(group: str, chance: Chance, times: float = 1.0) -> Scenario:
        """Return a scenario with those who come within `times` its horizon."""
        for clear in np.repeat(_CLEAR, _DRAWS):
            since = chance.between(0.0, max(last - 20.0, 0.0))
            # Each end is drawn as fractions of the area: how far along its side, and how far from it.
            (along, deep), (goal_along, goal_deep) = ((chance.between(0.15, 0.85), chance.between(0.04, 0.1)) for _ in range(2))
            side = chance.integer(0, 4)
            ends = (along, deep), (goal_along, 1.0 - goal_deep)  # from the lower side to the upper one
            if side % 2:
                ends = (deep, along), (1.0 - goal_deep, goal_along)  # from left to right
            places = low + np.array(ends if side < 2 else ends[::-1]) * (high - low)
            inset = ROBOT.radius + cell  # between an end and the edges of a narrow area
            start, goal = map(tuple, np.clip(places, low + inset, high - inset).tolist())
            horizon = max(60.0, 2.0 * math.dist(start, goal) / ROBOT.v_max)
            present = [w for w in walkers if w[0, 0] < since + horizon and w[-1, 0] > since]
            people = tuple(Obstacle(0.3, _walk(w, since, far)) for w in present)
            at = World(grid, people).timeline(0, 1.0).places(np.zeros(1))[0]
            if all(math.dist(place, start) > clear for place in at.tolist()):
                later = [_walk(w, since, far) for w in walkers if since + horizon <= w[0, 0] < since + times * horizon]
                people += tuple(Obstacle(0.3, walk) for walk in later if math.dist(place_at(walk.arrays, 0.0), start) > clear)
                return Scenario(World(grid, people), start, goal, robot=ROBOT, horizon=horizon, name=f"tracks {name}")
        raise BadScenario("tracks", file, f"a recording with starts that are {_CLEAR[-1]:g} m from everybody")

    return Suite(f"tracks:{name}-{content_hash(file)}", ("all",), make, default=50, lasting=make)


def read_tracks(file: str) -> NDArray[np.float64]:
    """Return a track file as rows t (s, from 0), id, x, y (m), float64[N, 4], by id and then time; far places begin at 0.

    Raises
    ------
    BadScenario, TooLarge
    """
    comma = Path(file).suffix.lower() == ".csv"
    table = _read_table(file, comma)
    by_id = 1, 0, 2, 3
    table = np.unique(table.take(by_id, axis=1), axis=0).take(by_id, axis=1)  # by id and then time, and equal rows once
    steps, same = np.diff(table[:, 0]), np.diff(table[:, 1]) == 0
    if (same & (steps <= 0)).any():
        t, name = table[int(np.argmax(same & (steps <= 0))), :2].tolist()
        raise BadScenario("tracks", f"two places of id {name:g} at {t:g} s", "of one place for each time and id", where=file)
    if not comma and same.any():
        found, times = np.unique(steps[same], return_counts=True)
        table[:, 0] *= 0.4 / found[np.argmax(times)]
    table[:, 0] -= table[:, 0].min()
    if np.abs(table[:, 2:]).max() > MAX_ORIGIN / 2:  # such as UTM coordinates, which are too far from 0 for an episode
        table[:, 2:] -= table[:, 2:].min(axis=0)
    return table


def _read_table(file: str, comma: bool) -> NDArray[np.float64]:
    """Return the rows (time or frame, id, x, y) of a track file, in the order of the file; `comma`: it is CSV."""
    path = Path(file)
    if not isfile(path):
        raise BadScenario("tracks", file, "an existing regular file")
    allowed = "the columns frame, id, x, z, y, vx, vz, vy of an obsmat.txt, or frame, id, x, y"
    if comma:
        allowed = "CSV lines t,id,x,y, or with a heading that names these columns"
    numbers: list[int] = []  # of the lines that were read as rows, from 1
    with opened(path, MAX_BYTES, error=BadScenario, field="tracks") as (data, _), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about files without lines, whose shape is refused below
        try:
            lines = _lines(io.TextIOWrapper(data, encoding="utf-8-sig"))
            # The heading may stand in a comment, as NumPy writes it; other comments say nothing.
            says = (
                (n, line) for n, line in lines if line.strip() and (line.lstrip()[0] != "#" or {*_COLUMNS} <= {*_names(line)})
            )
            first = next(says, (0, ""))
            named = _names(first[1])
            skip = comma and any(c.isalpha() for c in "".join(named).replace("e", ""))
            missing = [name for name in _COLUMNS if name not in named]
            if skip and missing:
                raise ValueError(f"a heading without {', '.join(missing)}")
            used = [named.index(name) for name in _COLUMNS] if skip else None
            rows = _rows(lines if skip else itertools.chain([first], lines), numbers)
            table = np.loadtxt(
                rows, delimiter="," if comma else None, ndmin=2, max_rows=MAX_ROWS + 1, usecols=used, quotechar='"'
            )
        except ValueError as error:
            field = f"tracks, line {numbers[-1]}" if numbers else "tracks"
            raise BadScenario(field, str(error).partition(" at row")[0], allowed, where=file) from None
    if len(table) > MAX_ROWS:
        raise TooLarge("tracks", f"{len(table)} rows or more", f"at most {MAX_ROWS} rows", where=file)
    y = {4: 3} if comma else {4: 3, 8: 4}  # the column of y, by the number of columns
    if table.ndim != 2 or len(table) < 2 or table.shape[1] not in y:
        raise BadScenario("tracks", f"{table.shape} numbers", f"{allowed}; at least two lines", where=file)
    sound = (np.abs(table) <= MAX_PLACE).all(axis=1)
    if not sound.all():
        row = int(np.argmin(sound))
        raise BadScenario(f"tracks, line {numbers[row]}", table[row].tolist(), "finite numbers, up to 1e10", where=file)
    return table[:, (0, 1, 2, y[table.shape[1]])]


def _lines(text: io.TextIOWrapper) -> Iterator[tuple[int, str]]:
    """Yield the lines of a file with their numbers, from 1."""
    for number in range(1, 2 * MAX_ROWS + 1):
        line = text.readline(MAX_LINE + 1)
        if len(line) > MAX_LINE:
            raise ValueError(f"line {number} of more than {MAX_LINE} letters")
        if not line:
            return
        yield number, line
    if text.readline(1):
        raise ValueError(f"more than {2 * MAX_ROWS} lines")


def _rows(lines: Iterable[tuple[int, str]], numbers: list[int]) -> Iterator[str]:
    """Yield the lines that are neither empty nor comments, and append the number of each to `numbers`."""
    for number, line in lines:
        if line.partition("#")[0].strip():
            numbers.append(number)
            yield line


def _names(heading: str) -> list[str]:
    """Return the names of the columns in a heading."""
    return [name.strip(" \"'\r\n").lower() for name in heading.lstrip("# \t").partition("#")[0].split(",")]


def walks(table: NDArray[np.float64], file: str) -> list[NDArray[np.float64]]:
    """Return the rows t, x, y of each person in a table of `read_tracks` of a file.

    A number that comes again after more than 3 s and 3 frames belongs to somebody else. Who was seen once is left out.

    Raises
    ------
    BadScenario
        If nobody was seen twice.

    Warns
    -----
    UserWarning
        If people walk so slowly or fast that times or places are probably in other units, or jump as if numbers were swapped.
    """
    steps, same = np.diff(table[:, 0]), np.diff(table[:, 1]) == 0
    if not same.any():
        raise BadScenario("tracks", len(table), "rows of which two or more have the same id", where=file)
    ends = np.flatnonzero(~same | (steps > max(_GAP, 3.0 * float(np.median(steps[same])))))
    found = [walk for walk in np.split(table[:, (0, 2, 3)], ends + 1) if len(walk) >= 2]
    far = np.array([np.hypot(*np.diff(walk[:, 1:], axis=0).T).sum() for walk in found])  # who turns back walks as far
    took = np.array([walk[-1, 0] - walk[0, 0] for walk in found])
    gone = np.array([np.hypot(*np.ptp(walk[:, 1:], axis=0)) > 2.0 for walk in found])
    speed = float(np.median((far / took)[gone])) if gone.any() else 1.0
    jumps = sum(_jumps(walk) for walk in found)
    if not 0.4 < speed < 4.0:
        units = "are times in s, or frames 0.4 s apart, and places in m?"
        warnings.warn(f"{file}: who walks does so at {speed:.2g} m/s (the median); {units}", stacklevel=3)
    elif jumps:
        warnings.warn(
            f"{file}: {jumps} steps are over 1 m long at over 8 m/s; do people swap their numbers there?", stacklevel=3
        )
    return found


def _jumps(walk: NDArray[np.float64]) -> int:
    """Return how many steps of a walk are longer than 1 m and faster than 8 m/s, which people are not."""
    t, x, y = np.diff(walk, axis=0).T
    return int((np.hypot(x, y) > np.maximum(8.0 * t, 1.0)).sum())


def _walk(rows: NDArray[np.float64], since: float, far: float) -> Replay:
    """Return a pedestrian's motion from time `since` on, continued with constant velocity up to `far` m before and after."""
    first, last = _velocity(rows), _velocity(rows[::-1])
    stride = math.ceil((_STEP - 1e-3) / float(np.median(np.diff(rows[:, 0]))))
    rows = np.vstack((rows[: max(len(rows) - stride, 1) : stride], rows[-1]))
    t, xy = rows[:, 0] - since, rows[:, 1:]
    record_start = float(t[0])
    lead, tail = (far / max(float(np.hypot(*v)), 0.1) for v in (first, last))
    t = np.concatenate(([t[0] - lead], t, [t[-1] + tail]))
    xy = np.vstack((xy[0] - first * lead, xy, xy[-1] + last * tail))
    return Replay(tuple(t.tolist()), tuple(map(tuple, xy.tolist())), record_start)


def _velocity(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the velocity at the first of rows t, x, y, which may go back in time: of a step, or of _LONGER if it is short."""
    age = np.abs(rows[:, 0] - rows[0, 0])
    k = 1 if age[1] > _STEP - 1e-3 else min(int(np.searchsorted(age, _LONGER - 1e-9)), len(rows) - 1)
    velocity: NDArray[np.float64] = (rows[k, 1:] - rows[0, 1:]) / (rows[k, 0] - rows[0, 0])
    return velocity


def barn() -> Suite:
    """Return fields of cylinders, as in the BARN challenge, in which discs move from key frame to key frame.

    A field is 20 x 8 m, with cells of 0.1 m; sparse ones have 12 cylinders and 6 discs, dense ones 24 and 12.
    """
    counts = {"sparse": (12, 6), "dense": (24, 12)}

    def make(group: str, chance: Chance) -> Scenario:
        pillars, discs = counts[group]
        while True:
            blocked = np.zeros((80, 200), np.bool_)
            rows, cols = np.indices(blocked.shape)
            for _ in range(pillars):
                row, col, radius = chance.between(0, 80), chance.between(25, 175), chance.between(2.0, 5.0)
                blocked |= np.hypot(rows - row, cols - col) < radius
            grid = Grid(blocked, 0.1)
            start, goal = (1.05, 4.05), (18.95, 4.05)
            if np.isfinite(distance_field(grid.inflate(ROBOT.radius + 0.1), grid.cell_at(goal))[grid.cell_at(start)]):
                break
        moving = tuple(Obstacle(0.3, _key_frames(grid, chance)) for _ in range(discs))
        ends = {"obstacle_speed": 0.8, "name": f"barn {group}"}
        return Scenario(World(grid, moving), start, goal, robot=ROBOT, sensor=Sensor(occlusion=False), **ends)  # type: ignore[arg-type]

    return Suite("barn", tuple(counts), make, default=50)


def _key_frames(grid: Grid, chance: Chance) -> Waypoints:
    """Return a round of four places with straight legs clear of the cylinders."""
    points: list[XY] = []
    while len(points) < 4:
        at = chance.between(3.0, 17.0), chance.between(0.5, 7.5)
        legs = [(points[-1] if points else at, at)] + ([(at, points[0])] if len(points) == 3 else [])
        if all(passes(grid, a, b, 0.3) for a, b in legs):
            points.append(at)
        elif chance.integer(0, 50) == 0:
            points.clear()
    return Waypoints(tuple(points), chance.between(0.3, 0.8), phase=chance.between(0.0, 1.0))


def _pick(chance: Chance, cells: NDArray[np.int64]) -> Cell:
    """Return one of the cells at random."""
    row, col = cells[chance.integer(0, len(cells))].tolist()
    return row, col
