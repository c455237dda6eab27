"""The travelling salesman problem with time windows: instances, their files, and the search for the best order."""

from __future__ import annotations

import math
import os
import re
import threading
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path as File

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadMap, BadParameter, TooLarge
from antway.maps.limits import as_path
from antway.planning import Budget
from antway.reading import decoded, numbers_in, read_bytes
from antway.tours.stops import checked_matrix, checked_windows
from antway.tours.windowed import Path, search

MAX_BYTES = 64_000_000
MAX_NODES = 1_000
_NEAR = 1e-9  # share of the cost; an order that others may beat by no more is proven to be the best
_ROUNDING = Fraction(1, 10**11)  # share of the time; a vehicle that is late by less is in time, as sums of floats are rounded


@dataclass(frozen=True, slots=True, eq=False)
class Tsptw:
    """A travelling salesman problem with time windows, as in the benchmark sets.

    Parameters
    ----------
    matrix : array_like[n, n]
        Time from node to node with service at the first, in [0, 1e9]; it may be asymmetric. The diagonal is ignored.
    windows : array_like[n, 2]
        Earliest and latest arrival; an early vehicle waits. Node 0 is the depot: the vehicle leaves when its window opens and
        returns before it closes.
    name : str

    Raises
    ------
    BadParameter, TooLarge

    Examples
    --------
    >>> task = Tsptw([[0, 2, 2], [2, 0, 1], [2, 1, 0]], [[0, 10], [0, 9], [0, 2]])
    >>> solve_tsptw(task, cycles=5).order.tolist()
    [0, 2, 1]
    """

    matrix: NDArray[np.float64]
    windows: NDArray[np.float64]
    name: str = ""

    def __post_init__(self) -> None:
        checks.instance("name", self.name, str)
        matrix = checked_matrix(self.matrix, MAX_NODES, "nodes", finite=True)
        windows = checked_windows(self.windows, len(matrix))
        matrix.flags.writeable = windows.flags.writeable = False
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "windows", windows)

    @property
    def size(self) -> int:
        """Number of nodes, including the depot."""
        return len(self.matrix)


@dataclass(frozen=True, slots=True, eq=False)
class TsptwResult:
    """The result of `solve_tsptw`.

    Attributes
    ----------
    order : int32[n]
        The nodes in the order of the tour, the depot 0 first.
    cost : float
        The objective: the sum of times along the closed tour, or the time of the return to the depot.
    feasible : bool
        Whether no window is missed, but for 1e-11 of the time, which sums of numbers such as sqrt(2) are wrong by.
    lateness : float
        Sum of the delays of arrivals after the ends of windows; 0.0 if feasible.
    conflict : tuple of int
        If no order is feasible: one to three nodes that no order visits in time; empty if no such few nodes show it.
    proven : bool
        Whether the order is proven to be the best; for an infeasible result, whether no order is feasible.
    bound : float
        No feasible order costs less.
    cycles : int
        Number of cycles of the colony.
    history : float64[h, 3]
        (cycle, best cost, seconds) at each improvement of the best feasible order.
    elapsed : float
        Seconds.
    """

    order: NDArray[np.int32]
    cost: float
    feasible: bool
    lateness: float
    conflict: tuple[int, ...]
    proven: bool
    bound: float
    cycles: int
    history: NDArray[np.float64]
    elapsed: float

    def __post_init__(self) -> None:
        self.order.flags.writeable = self.history.flags.writeable = False


def solve_tsptw(
    instance: Tsptw,
    *,
    objective: str = "travel time",
    seconds: float | None = None,
    cycles: int | None = None,
    seed: int = 0,
    target: float | None = None,
    initial: object = None,
    cancel: threading.Event | None = None,
) -> TsptwResult:
    """Search for the best closed tour that misses no window.

    Beams of ants build orders, forward and backward in time, by pheromone (Beam-ACO: Lopez-Ibanez, Blum, Computers &
    Operations Research 37, 2010). Local search improves each order, again and again after random moves. From time to time a
    wide beam explores all partial orders that may lead to something better; once it drops none, the best order is proven.

    Parameters
    ----------
    instance : Tsptw
    objective : str
        "travel time" or "makespan" (the time of the return).
    seconds, cycles : float, int or None
        When to stop, whichever comes first; without both, after 10 s. Seconds may be infinite. The search also ends once the
        best order is proven.
    seed : int
        In [0, 2**64 - 1]. The same seed and number of cycles give the same bytes.
    target : float or None
        The search stops at this cost.
    initial : sequence of int or None
        An initial order of all nodes, the depot first.
    cancel : threading.Event or None
        Ends the search when set; the best order so far is returned.

    Raises
    ------
    BadParameter

    Examples
    --------
    >>> task = Tsptw([[0, 2, 2], [2, 0, 1], [2, 1, 0]], [[0, 10], [0, 1], [0, 3]])
    >>> result = solve_tsptw(task, cycles=5)
    >>> result.feasible, result.conflict
    (False, (1,))
    """
    checks.instance("instance", instance, Tsptw)
    makespan = checks.objective(objective) == "makespan"
    checks.seed(seed)
    good = -math.inf if target is None else checks.number("target", target)
    n = instance.size
    first = None
    if initial is not None:
        nodes = checks.array("initial", initial, (n,))
        if nodes[0] != 0 or not np.array_equal(np.sort(nodes), np.arange(n)):
            raise BadParameter("initial", initial, f"a permutation of the nodes 0 to {n - 1} that begins with 0")
        first = np.append(nodes, n).astype(np.int32)
    clock = Budget(seconds=10.0 if seconds is None and cycles is None else seconds, cycles=cycles, cancel=cancel).start()
    # The depot is at both ends of the path.
    again = np.append(np.arange(n), 0)
    path = Path(instance.matrix[np.ix_(again, again)], instance.windows[again, 0], instance.windows[again, 1])
    found = search(path, clock, makespan=makespan, cycles=cycles, seed=seed, target=good, initial=first)
    order = found.order[:-1]
    cost, late = evaluate(instance, order, makespan)
    feasible = late == 0.0
    proven = found.proven and feasible == (found.late == 0.0)  # `found` may be late by what `path` rounds
    bound = path.bound(makespan)
    if feasible:
        least = cost if found.off <= _NEAR * cost else cost - found.off
        bound = min(cost, max(bound, least) if proven else bound)
        proven = proven and bound == cost
    conflict = tuple(sorted({node % n for node in found.conflict}))
    history = np.array(found.history, dtype=np.float64).reshape(-1, 3)
    return TsptwResult(order.copy(), cost, feasible, late, conflict, proven, bound, found.cycles, history, clock.elapsed())


def evaluate(instance: Tsptw, order: NDArray[np.int32], makespan: bool) -> tuple[float, float]:
    """Return cost and lateness of the closed tour `order`; times are decimal numbers, whose sums are exact."""

    def exact(value: float) -> Fraction:
        return Fraction(repr(float(value)))

    closed = [*order.tolist(), int(order[0])]
    now, late = exact(instance.windows[closed[0], 0]), Fraction(0)
    for here, there in pairwise(closed):
        opens, closes = instance.windows[there]
        now = max(now + exact(instance.matrix[here, there]), exact(opens))
        if closes < math.inf and now - exact(closes) > _ROUNDING * (1 + now):
            late += now - exact(closes)
    return float(now) if makespan else math.fsum(instance.matrix[closed[:-1], closed[1:]]), float(late)


def load_tsptw(path: str | os.PathLike[str]) -> Tsptw:
    """Read an instance in the usual text format: the number of nodes n, n x n times, n windows; `#` starts a comment.

    Parameters
    ----------
    path : path_like
        At most 64 MB and 1,000 nodes.

    Raises
    ------
    BadMap
        If it is not such a file; the message names the node.
    TooLarge
        If it exceeds a limit.
    """
    return parse(read_bytes(as_path(path), MAX_BYTES, field="path"), os.fspath(path))


def parse(data: bytes, where: str = "") -> Tsptw:
    """Return the instance in `data`; messages name `where`."""
    text = re.sub(rb"#[^\r\n]*", b"", decoded(data, where).encode())
    first = re.search(rb"\S+", text)
    word = first[0][:80].decode(errors="replace") if first else ""
    if not (word.isascii() and word.isdigit() and len(word) < 10) or int(word) < 1:
        raise BadMap("n", word, "a whole number of nodes >= 1", where=where)
    n = int(word)
    if n > MAX_NODES:
        raise TooLarge("n", n, f"at most {MAX_NODES} nodes", where=where)
    values = numbers_in(text, 2 + n * n + 2 * n, where)[1:]
    if len(values) != n * n + 2 * n:
        raise BadMap("numbers", len(values), f"{n * n + 2 * n}: {n} x {n} times and {n} windows", where=where)
    if not (np.abs(values) <= 1e9).all():
        raise BadMap("numbers", float(values[~(np.abs(values) <= 1e9)][0]), "in [-1e9, 1e9]", where=where)
    try:
        return Tsptw(values[: n * n].reshape(n, n), values[n * n :].reshape(n, 2), File(where).name)
    except BadParameter as error:
        raise BadMap(error.field, error.value, error.allowed, where=where) from None
