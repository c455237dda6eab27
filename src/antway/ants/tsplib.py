"""Instances of the travelling salesman problem and their files (Reinelt: TSPLIB95, 1995). Wrong files raise `BadMap`."""

from __future__ import annotations

import os
import string
from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadMap, BadParameter, TooLarge
from antway.kernels.colony import tour as kernel
from antway.maps.limits import as_path
from antway.reading import decoded, numbers_in, read_bytes

MAX_BYTES = 64_000_000
MAX_CITIES = 200_000
MAX_LINES = 1_000_000
MAX_MATRIX = 5_001  # limit of cities with a matrix (200 MB); an open tour of 5,000 stops has one node more

OPTIMA = {
    "burma14": 3323, "ulysses16": 6859, "gr17": 2085, "gr21": 2707, "ulysses22": 7013, "gr24": 1272, "fri26": 937,
    "bayg29": 1610, "bays29": 2020, "dantzig42": 699, "swiss42": 1273, "att48": 10628, "gr48": 5046, "hk48": 11461,
    "eil51": 426, "berlin52": 7542, "brazil58": 25395, "st70": 675, "eil76": 538, "pr76": 108159, "gr96": 55209, "rat99": 1211,
    "kroA100": 21282, "kroB100": 22141, "kroC100": 20749, "kroD100": 21294, "kroE100": 22068, "rd100": 7910, "eil101": 629,
    "lin105": 14379, "pr107": 44303, "gr120": 6942, "pr124": 59030, "bier127": 118282, "ch130": 6110, "pr136": 96772,
    "gr137": 69853, "pr144": 58537, "ch150": 6528, "kroA150": 26524, "kroB150": 26130, "pr152": 73682, "u159": 42080,
    "si175": 21407, "brg180": 1950, "rat195": 2323, "d198": 15780, "kroA200": 29368, "kroB200": 29437, "gr202": 40160,
    "ts225": 126643, "tsp225": 3916, "pr226": 80369, "gr229": 134602, "gil262": 2378, "pr264": 49135, "a280": 2579,
    "pr299": 48191, "lin318": 42029, "rd400": 15281, "fl417": 11861, "gr431": 171414, "pr439": 107217, "pcb442": 50778,
    "d493": 35002, "att532": 27686, "ali535": 202339, "si535": 48450, "pa561": 2763, "u574": 36905, "rat575": 6773,
    "p654": 34643, "d657": 48912, "gr666": 294358, "u724": 41910, "rat783": 8806, "dsj1000": 18660188, "pr1002": 259045,
    "si1032": 92650, "u1060": 224094, "vm1084": 239297, "pcb1173": 56892, "d1291": 50801, "rl1304": 252948, "rl1323": 270199,
    "nrw1379": 56638, "fl1400": 20127, "u1432": 152970, "fl1577": 22249, "d1655": 62128, "vm1748": 336556, "u1817": 57201,
    "rl1889": 316536, "d2103": 80450, "u2152": 64253, "u2319": 234256, "pr2392": 378032, "pcb3038": 137694, "fl3795": 28772,
    "fnl4461": 182566, "rl5915": 565530, "rl5934": 556045, "pla7397": 23260728, "rl11849": 923288, "usa13509": 19982859,
    "brd14051": 469385, "d15112": 1573084, "d18512": 645238, "pla33810": 66048945, "pla85900": 142382641,
}  # fmt: skip
_KINDS: dict[str, int] = {name: getattr(kernel, name) for name in ("MATRIX", "EUC_2D", "CEIL_2D", "ATT", "EUCLID")}
_KINDS["GEO"] = kernel.MATRIX
_BLOCK = 8192  # number of cities whose neighbours are computed at once
_MATRIX_UP_TO = 1_000  # number of cities up to which a table of distances is faster than computing them


@dataclass(frozen=True, slots=True, eq=False)
class Tsp:
    """A symmetric travelling salesman problem.

    Parameters
    ----------
    xy : array_like[n, 2] or None
        Places of the cities; |coordinate| <= 1e9. For the metric GEO: latitude and longitude in degrees.minutes.
    matrix : array_like[n, n] or None
        Symmetric distances >= 0; the diagonal is ignored. Exactly one of `xy` and `matrix` is given.
    metric : str
        How distances follow from `xy`: EUCLID (not rounded), or TSPLIB's EUC_2D, CEIL_2D, ATT or GEO. Left out for a matrix.
    name : str
    optimum : float or None
        Length of the shortest tour, if it is known.

    Raises
    ------
    BadParameter, TooLarge

    Examples
    --------
    >>> Tsp([(0, 0), (0, 3), (4, 3)]).length([0, 1, 2])
    12.0
    """

    xy: NDArray[np.float64] | None = None
    matrix: NDArray[np.float64] | None = None
    metric: str = "EUCLID"
    name: str = ""
    optimum: float | None = None
    table: NDArray[np.float64] | None = field(init=False, repr=False)  # [n, n] `matrix`, or the distances that GEO gives

    def __post_init__(self) -> None:
        checks.instance("name", self.name, str)
        if (self.xy is None) == (self.matrix is None):
            raise BadParameter("xy", self.xy, "given, or matrix, and not both")
        if self.matrix is not None:
            if self.metric not in ("EUCLID", "MATRIX"):  # the default, and what a copy has
                raise BadParameter("metric", self.metric, "left out where a matrix is given")
            matrix = checks.array("matrix", self.matrix, (None, None), finite=False)
            if len(matrix) > MAX_MATRIX:
                raise TooLarge("matrix", len(matrix), f"at most {MAX_MATRIX} cities")
            if matrix.shape[0] != matrix.shape[1] or len(matrix) == 0:
                raise BadParameter("matrix.shape", matrix.shape, "square and not empty")
            matrix.flags.writeable = True
            np.fill_diagonal(matrix, 0.0)
            matrix.flags.writeable = False
            if not ((matrix == matrix.T) & (matrix >= 0) & (matrix <= 2e9)).all():
                raise BadParameter("matrix", matrix, "symmetric, of distances in [0, 2e9]")
            object.__setattr__(self, "matrix", matrix)
            object.__setattr__(self, "table", matrix)
            object.__setattr__(self, "metric", "MATRIX")
        else:
            checks.choice("metric", self.metric, [kind for kind in _KINDS if kind != "MATRIX"])
            xy = checks.array("xy", self.xy, (None, 2))
            if len(xy) == 0 or (np.abs(xy) > 1e9).any():
                raise BadParameter("xy", xy, "one place or more, of coordinates in [-1e9, 1e9]")
            limit = MAX_MATRIX if self.metric == "GEO" else MAX_CITIES
            if len(xy) > limit:
                raise TooLarge("xy", len(xy), f"at most {limit} cities")
            object.__setattr__(self, "xy", xy)
            object.__setattr__(self, "table", _geographic(xy) if self.metric == "GEO" else None)
        if self.optimum is not None:
            checks.fields(self, "optimum", low=0.0)

    @property
    def size(self) -> int:
        """Number of cities."""
        given = self.matrix if self.xy is None else self.xy
        assert given is not None
        return len(given)

    def length(self, order: object) -> float:
        """Return the length of the closed tour `order`, a permutation of the cities 0 ... n - 1."""
        return float(kernel.length(self._metric(), permutation("order", order, self.size)))

    def _metric(self) -> kernel.Metric:
        """Return the distances for kernels; arrays are writable, so that kernels are compiled for one type only."""
        xy = np.zeros((0, 2)) if self.xy is None or self.table is not None else self.xy.copy()
        matrix = np.zeros((0, 0)) if self.table is None else self.table.copy()
        return kernel.Metric(_KINDS[self.metric], xy, matrix)

    def cities(self, candidates: int, *, by_quadrant: bool = False) -> kernel.Cities:
        """Return the distances and the `candidates` nearest cities of each city (k-d tree, or whole rows) for kernels.

        With `by_quadrant`, four fifths of them are the nearest ones in each quadrant around the city, if there are places.
        """
        n = self.size
        k = min(candidates, n - 1)
        metric = self._metric()
        xy = metric.xy
        if k == n - 1:
            near = np.array([np.delete(np.arange(n), i) for i in range(n)])
        elif self.table is not None and self.xy is not None and by_quadrant:
            found = _nearest(self.table, min(12 * k, n - 1))
            near = _by_quadrant(np.arange(n), found, _bearings(self.xy, found), k)
        elif self.table is not None:
            near = _nearest(self.table, k)
        elif by_quadrant:
            near = _around(xy, k)
        else:
            found = np.asarray(scipy.spatial.cKDTree(xy).query(xy, k + 1)[1])
            # If several cities are in one place, the tree may return the city itself anywhere, or not at all.
            own = found == np.arange(n)[:, None]
            own[~own.any(axis=1), k] = True
            near = found[~own]
        near = near.reshape(n, k).astype(np.uint32)
        gap = kernel.gaps(metric, near)
        ranking = np.argsort(gap, axis=1, kind="stable")
        near, gap = np.take_along_axis(near, ranking, 1), np.take_along_axis(gap, ranking, 1)
        if self.table is None and n <= _MATRIX_UP_TO:
            table = kernel.gaps(metric, np.tile(np.arange(n, dtype=np.uint32), (n, 1)))
            metric = kernel.Metric(kernel.MATRIX, metric.xy, table)
        span = metric.matrix.max(initial=0.0) if metric.matrix.size else float(np.hypot(*np.ptp(xy, axis=0)))
        return kernel.Cities(metric, near, gap, 1e-12 * float(span), kernel.backs(near))


def _around(xy: NDArray[np.float64], k: int) -> NDArray[np.int64]:
    """Return k other cities for each city, int64[n, k]: the k // 5 nearest in each quadrant, then the nearest of the rest.

    A quadrant is searched among the 12 k nearest cities. If cities form clusters or rows, the nearest ones are all in the same
    cluster or row, but a tour needs edges that leave it.
    """
    n = len(xy)
    tree, many = scipy.spatial.cKDTree(xy), min(n - 1, 12 * k) + 1
    near = np.empty((n, k), dtype=np.int64)
    for first in range(0, n, _BLOCK):
        part = np.arange(first, min(first + _BLOCK, n))
        found = np.asarray(tree.query(xy[part], many)[1])
        near[part] = _by_quadrant(part, found, xy[found] - xy[part, None], k)
    return near


def _by_quadrant(cities: NDArray[np.int64], found: NDArray[np.int64], offset: NDArray[np.float64], k: int) -> NDArray[np.int64]:
    """Return k other cities of `found` for each city: the first k // 5 in each quadrant of `offset`, then the first others."""
    many = found.shape[1]
    dx, dy = np.moveaxis(offset, -1, 0)
    quadrant = np.select([(dx > 0) & (dy >= 0), (dx <= 0) & (dy > 0), (dx < 0) & (dy <= 0)], [0, 1, 2], 3)
    own = found == cities[:, None]
    key = np.tile(np.arange(many), (len(found), 1)) + many
    for number in range(4):
        members = (quadrant == number) & ~own
        key[members & (np.cumsum(members, axis=1) <= k // 5)] -= many
    key[own] = 3 * many
    return np.take_along_axis(found, np.argsort(key, axis=1)[:, :k], 1)


def _nearest(matrix: NDArray[np.float64], k: int) -> NDArray[np.int64]:
    """Return the k nearest other cities of each city, nearest first, int64[n, k]."""
    own = np.arange(len(matrix))
    return np.array([np.argsort(np.where(own == i, np.inf, row), kind="stable")[:k] for i, row in enumerate(matrix)])


def _degrees(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert degrees.minutes, TSPLIB's notation of latitudes and longitudes, to degrees."""
    whole = np.trunc(places)
    return whole + 5.0 * (places - whole) / 3.0


def _bearings(places: NDArray[np.float64], found: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return how far east and north of each city the `found` cities are, float64[n, m, 2]."""
    latitude, longitude = _degrees(places).T
    east = (longitude[found] - longitude[:, None] + 180.0) % 360.0 - 180.0
    return np.stack((east * np.cos(np.radians(latitude))[:, None], latitude[found] - latitude[:, None]), axis=-1)


def permutation(field: str, order: object, n: int) -> NDArray[np.uint32]:
    """Return `order` as uint32[n] if it is a permutation of 0 ... n - 1."""
    result = checks.array(field, order, (n,))
    if not np.array_equal(np.sort(result), np.arange(n)):
        raise BadParameter(field, order, f"a permutation of the cities 0 to {n - 1}")
    return result.astype(np.uint32)


def load_tsp(path: str | os.PathLike[str]) -> Tsp:
    """Read a TSPLIB file of TYPE TSP: EUC_2D, CEIL_2D, ATT, GEO, or EXPLICIT in any of its matrix formats.

    Parameters
    ----------
    path : path_like
        At most 64 MB, 200,000 cities, or 5,001 with a matrix (EXPLICIT and GEO).

    Returns
    -------
    Tsp
        With the optimum, if the name is that of a well-known instance of as many cities.

    Raises
    ------
    BadMap
        If it is not such a file.
    TooLarge
        If it exceeds a limit.
    """
    return parse(read_bytes(as_path(path), MAX_BYTES, field="path"), os.fspath(path))


def parse(data: bytes, where: str = "") -> Tsp:
    """Return the instance in `data`; messages name `where`."""
    lines = data.count(b"\n") + data.count(b"\r")
    if lines > MAX_LINES:  # a line takes more memory than its bytes
        raise TooLarge("lines", lines, f"at most {MAX_LINES}", where=where)
    header, sections = _split(decoded(data, where).splitlines(), where)
    checks.choice("TYPE", header.get("TYPE", "TSP").split(" ")[0], ["TSP"], error=BadMap, where=where)
    text = header.get("DIMENSION", "")
    if not (text.isascii() and text.isdigit() and len(text) < 10) or int(text) < 1:
        raise BadMap("DIMENSION", text, "a whole number >= 1", where=where)
    fixed = [line for line in sections.get("FIXED_EDGES_SECTION", []) if line != "-1"]
    if fixed:  # as in linhp318: without them another tour is the shortest
        raise BadMap("FIXED_EDGES_SECTION", fixed[0], "empty: no edge can be fixed", where=where)
    n = int(text)
    kinds = ["EUC_2D", "CEIL_2D", "ATT", "GEO", "EXPLICIT"]
    kind = checks.choice("EDGE_WEIGHT_TYPE", header.get("EDGE_WEIGHT_TYPE", ""), kinds, error=BadMap, where=where)
    limit = MAX_MATRIX if kind in ("GEO", "EXPLICIT") else MAX_CITIES
    if n > limit:
        raise TooLarge("DIMENSION", n, f"at most {limit} cities of type {kind}", where=where)
    name = header.get("NAME", "")
    known = name.removesuffix(".tsp")
    optimum = OPTIMA.get(known) if known.lstrip(string.ascii_letters) == str(n) else None  # names end with the number of cities
    if kind == "EXPLICIT":
        weights = _numbers("EDGE_WEIGHT_SECTION", sections, n * n, where)
        return Tsp(matrix=_matrix(weights, n, header.get("EDGE_WEIGHT_FORMAT", ""), where), name=name, optimum=optimum)
    rows = _numbers("NODE_COORD_SECTION", sections, 3 * n, where)
    if len(rows) != 3 * n:
        raise BadMap("NODE_COORD_SECTION", len(rows), f"{3 * n} numbers: a number and two coordinates per city", where=where)
    rows = rows.reshape(n, 3)
    if not np.array_equal(np.sort(rows[:, 0]), np.arange(1, n + 1)):
        raise BadMap("NODE_COORD_SECTION", rows[:, 0].tolist()[:5], f"the cities 1 to {n}, each once", where=where)
    xy = rows[np.argsort(rows[:, 0]), 1:]
    return Tsp(xy=xy, metric=kind, name=name, optimum=optimum)


def _split(lines: list[str], where: str) -> tuple[dict[str, str], dict[str, list[str]]]:
    """Return the header's `KEY : value` and the lines of each section."""
    header: dict[str, str] = {}
    sections: dict[str, list[str]] = {}
    body: list[str] | None = None
    for number, line in enumerate(lines, 1):
        words = line.strip()
        first = words[:1]
        if words == "EOF":
            break
        if not first:
            continue
        if not first.isalpha():
            if body is None:
                raise BadMap("line", words, "KEY : value, or a section's name", where=f"{where}:{number}")
            body.append(words)
            continue
        key, colon, value = words.partition(":")
        key = key.strip()
        if (key in header or key in sections) and key != "COMMENT":  # COMMENT may occur several times, as in usa13509
            raise BadMap("line", words, "the only one of its key", where=f"{where}:{number}")
        if key.endswith("_SECTION") and not value.strip():
            body = sections[key] = []
        elif colon:
            header[key] = value.strip()
            body = None
        else:
            raise BadMap("line", words, "KEY : value, or a section's name", where=f"{where}:{number}")
    return header, sections


def _numbers(section: str, sections: dict[str, list[str]], most: int, where: str) -> NDArray[np.float64]:
    """Return the numbers of a section; as soon as there are more than `most` it is refused."""
    if section not in sections:
        raise BadMap(section, None, "in the file", where=where)
    result = numbers_in("\n".join(sections[section]).encode(), most, where, field=section)
    if not (np.abs(result) <= 1e9).all():
        raise BadMap(section, float(result[~(np.abs(result) <= 1e9)][0]), "numbers in [-1e9, 1e9]", where=where)
    return result


def _matrix(weights: NDArray[np.float64], n: int, form: str, where: str) -> NDArray[np.float64]:
    """Return the full matrix of EXPLICIT weights; a triangle by columns equals the other triangle by rows."""
    triangles = [f"{part}{diag}{line}" for part in ("UPPER_", "LOWER_") for diag in ("", "DIAG_") for line in ("ROW", "COL")]
    checks.choice("EDGE_WEIGHT_FORMAT", form, ["FULL_MATRIX", *triangles], error=BadMap, where=where)
    full = form == "FULL_MATRIX"
    shift = 0 if "DIAG" in form else 1
    wanted = n * n if full else n * (n + 1) // 2 - shift * n
    if len(weights) != wanted:
        raise BadMap("EDGE_WEIGHT_SECTION", len(weights), f"{wanted} weights for {form} of {n} cities", where=where)
    if full:
        matrix = weights.reshape(n, n).copy()
    else:
        matrix = np.zeros((n, n))
        upper = form.startswith("UPPER") == form.endswith("ROW")
        matrix[np.triu_indices(n, shift) if upper else np.tril_indices(n, -shift)] = weights
        matrix = matrix + matrix.T
    np.fill_diagonal(matrix, 0.0)
    wrong = np.argwhere((matrix < 0) | (matrix != matrix.T))
    if len(wrong):
        i, j = wrong[0].tolist()
        allowed = f"symmetric, of weights >= 0; these are those between the cities {i + 1} and {j + 1}"
        raise BadMap("EDGE_WEIGHT_SECTION", (float(matrix[i, j]), float(matrix[j, i])), allowed, where=where)
    return matrix


def _geographic(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return TSPLIB's GEO distances in km between places in degrees.minutes (latitude, longitude)."""
    latitude, longitude = (3.141592 * _degrees(places) / 180.0).T
    result = np.zeros((len(places), len(places)))
    for i in range(len(places)):
        q1 = np.cos(longitude[i] - longitude)
        q2 = np.cos(latitude[i] - latitude)
        q3 = np.cos(latitude[i] + latitude)
        result[i] = np.trunc(6378.388 * np.arccos(np.clip(0.5 * ((1.0 + q1) * q2 - (1.0 - q1) * q3), -1.0, 1.0)) + 1.0)
    np.fill_diagonal(result, 0.0)
    result = np.maximum(result, result.T)
    result.flags.writeable = False
    return result
