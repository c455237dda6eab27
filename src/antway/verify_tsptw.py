"""An independent check of orders with time windows, which shares no code with the search and adds exact fractions."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING

from antway import checks
from antway.errors import BadParameter, InvalidPlan

if TYPE_CHECKING:
    from antway.tours.time_windows import Tsptw


def check_tsptw(
    instance: Tsptw, order: Iterable[int], cost: float | None = None, *, objective: str = "travel time", feasible: bool = True
) -> None:
    """Raise `InvalidPlan` with all reasons why `order` is not an answer to `instance`.

    Parameters
    ----------
    instance : Tsptw
    order : iterable of int
        All nodes, the depot 0 first.
    cost : float or None
        The claimed cost.
    objective : str
        "travel time" or "makespan".
    feasible : bool
        Whether the order claims to miss no window.

    Raises
    ------
    BadParameter
        For arguments of a wrong type, or an unknown objective.
    InvalidPlan
        If a node is missing or visited twice, a window is missed by more than 1e-11 of the time, or the cost differs. Numbers
        count as their shortest decimal representations, so that sums are exact.

    Examples
    --------
    >>> from antway.tours.time_windows import Tsptw
    >>> check_tsptw(Tsptw([[0, 2, 2], [2, 0, 1], [2, 1, 0]], [[0, 10], [0, 9], [0, 3]]), [0, 2, 1], 5.0)
    """
    if type(instance).__name__ != "Tsptw":  # its module cannot be imported here, because the check shares no code with it
        raise BadParameter("instance", instance, "a Tsptw")
    listed = checks.sequence("order", order, "the nodes in their order")
    stops = [checks.integer(f"order[{i}]", stop) for i, stop in enumerate(listed)]
    if cost is not None:
        cost = checks.number("cost", cost)
    checks.objective(objective)
    checks.instance("feasible", feasible, bool)
    n = len(instance.matrix)
    if sorted(stops) != list(range(n)) or stops[0] != 0:
        raise InvalidPlan([f"visits {stops[:20]}, not each of the nodes 0 to {n - 1} once and 0 first"])
    faults = []
    travelled, now = Fraction(0), Fraction(repr(float(instance.windows[0][0])))
    for here, there in pairwise([*stops, 0]):
        step = Fraction(repr(float(instance.matrix[here][there])))
        earliest, latest = (float(end) for end in instance.windows[there])
        travelled += step
        now = max(now + step, Fraction(repr(earliest)))
        if feasible and latest != float("inf") and now - Fraction(repr(latest)) > Fraction(1, 10**11) * (1 + now):
            faults.append(f"node {there} is reached at {float(now)}, after {latest}")
    total = now if objective == "makespan" else travelled
    if cost is not None and abs(Fraction(cost) - total) > Fraction(1, 10**9) * (1 + total):
        faults.append(f"costs {float(total)}, not {cost}")
    if faults:
        raise InvalidPlan(faults)
