"""One tab of the page of tours: a colony that solves a travelling salesman problem, one cycle after another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.ants.colony import Colony
from antway.ants.persistence import Adaptive
from antway.ants.rules import RULES
from antway.ants.tsp import default_ants, default_candidates, local_search_options
from antway.ants.tsplib import Tsp
from antway.errors import BadParameter, TooLarge
from antway.limits import MAX_PAGE_SEED
from antway.view.pages import to_base64
from antway.web.files import as_file, decoded, stem
from antway.web.tab import Tab
from antway.web.view import Message, short, short_rows

MAX_CITIES = 5000
MIN_CITIES = 4  # least number of cities of a colony
SEARCHES = ("none", "2opt", "oropt", "3opt")
PERSISTENCES = ("the rule's", "adaptive")
_EDGES = 2000  # limit of edges with pheromone in a frame


def _scattered() -> Tsp:
    return Tsp(np.random.default_rng(1).uniform(0.0, 1000.0, (120, 2)), name="scattered")


def _clusters() -> Tsp:
    rng = np.random.default_rng(2)
    centres = rng.uniform(100.0, 900.0, (12, 2))
    return Tsp(centres[rng.integers(12, size=300)] + rng.normal(0.0, 40.0, (300, 2)), name="clusters")


def _ring() -> Tsp:
    angle = 2.0 * np.pi * np.arange(40) / 40
    ring = Tsp(500.0 + 450.0 * np.column_stack((np.cos(angle), np.sin(angle))), name="ring")
    return Tsp(ring.xy, name="ring", optimum=ring.length(np.arange(40)))


def _drawn() -> Tsp:
    return Tsp(np.array([(300.0, 300.0), (700.0, 300.0), (700.0, 700.0), (300.0, 700.0)]), name="drawn")


INSTANCES: dict[str, Callable[[], Tsp]] = {"scattered": _scattered, "clusters": _clusters, "ring": _ring, "drawn": _drawn}
Frame = tuple[NDArray[np.float64], NDArray[np.float64]]  # the lowest corner of a map and its size
_SQUARE: Frame = (np.zeros(2), np.full(2, 1000.0))


class Tours(Tab):
    """The state of a tab; its speed is in cycles per second."""

    SPEEDS = (1.0, 4.0, 16.0, 64.0, 1024.0)

    def __init__(self) -> None:
        super().__init__(16.0)
        self.map = _SQUARE
        self.settings: dict[str, Any] = {
            "rule": "mmas",
            "search": "none",
            "persistence": PERSISTENCES[0],
            "ants": 25,
            "seed": 0,
        }
        self._restart(INSTANCES["scattered"](), self.settings)

    @property
    def period(self) -> float:
        """Seconds of the clock that a cycle takes."""
        return 1.0 / self.speed

    @property
    def ended(self) -> bool:
        """Whether the best tour is known to be the shortest."""
        optimum = self.instance.optimum
        return optimum is not None and self.colony.best_cost <= optimum * (1 + 1e-12)

    def advance(self) -> None:
        """Run a cycle."""
        if not self.closed.is_set() and not self.ended:
            self.colony.run(1, np.empty((1, 2)))
            self.curve.append((float(self.colony.cycle), self.colony.best_cost, float(self.colony.state.lengths.mean())))
        if self.ended:
            self.playing = False

    def frame(self) -> Message:
        """Return the present state of the colony: at most 60 kB as JSON."""
        curve = self.curve[:]
        self.curve.clear()
        if len(curve) > 200:
            curve = [curve[i] for i in np.linspace(0, len(curve) - 1, 200).astype(int)]
        best = self.colony.best_cost
        optimum = self.instance.optimum
        ends, amounts = self._trails()
        return {
            "kind": "frame",
            "playing": self.playing,
            "speed": self.speed,
            "cycle": self.colony.cycle,
            "tours": self.colony.cycle * self.colony.tours,
            "best": short(best),
            "gap": None if not optimum or not np.isfinite(best) else short(100.0 * (best / optimum - 1.0)),
            "ended": self.ended,
            "curve": short_rows(curve),
            "tour": to_base64(self.colony.best, "<u2") if self.colony.cycle else None,
            "ends": to_base64(ends, "<u2"),
            "amounts": to_base64(amounts, "u1"),
        }

    def describe(self) -> Message:
        """Return what does not change while the colony runs: the cities and the settings."""
        xy, instance = self.instance.xy, self.instance
        low, size = self.map
        assert xy is not None
        return {
            "kind": "scene",
            "name": instance.name,
            "size": instance.size,
            "optimum": instance.optimum,
            "cities": to_base64(np.round((xy - low) / size.max() * 65535), "<u2"),
            "frame": np.round(size / size.max() * 65535).tolist(),
            "settings": self.settings,
        }

    def _trails(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the edges with the most pheromone, int[m, 2], and their amounts scaled to [0, 255]."""
        tau, near = self.colony.state.tau, self.colony.cities.near.astype(np.int64)
        low, high = float(tau.min()), float(tau.max())
        if high <= low * (1 + 1e-9):
            return np.empty((0, 2), np.int64), np.empty(0)
        amount = ((tau - low) / (high - low)).ravel()
        order = np.argsort(-amount, kind="stable")[:_EDGES]
        order = order[amount[order] > 0.04]
        ends = np.sort(np.column_stack((order // near.shape[1], near.ravel()[order])), axis=1)
        first = np.unique(ends, axis=0, return_index=True)[1]
        return ends[first], np.round(255 * amount[order][first])

    def _restart(self, instance: Tsp, settings: dict[str, Any], frame: Frame | None = None) -> list[Message]:
        """Restart with these, and with another map if one is given; if that is refused, nothing changes."""
        if instance.metric in ("MATRIX", "GEO"):
            raise BadParameter(
                "EDGE_WEIGHT_TYPE", instance.metric, "one of cities with places: EUC_2D, CEIL_2D or ATT", where=instance.name
            )
        if instance.size > MAX_CITIES:
            raise TooLarge("DIMENSION", instance.size, f"at most {MAX_CITIES} cities on the page", where=instance.name)
        search = None if settings["search"] == "none" else settings["search"]
        options, rule = local_search_options(instance.size, settings["rule"], search, None)
        colony = Colony(
            instance,
            rule,
            ants=default_ants(options) if options.attempts and not options.rebuild_every else settings["ants"],
            persistence=Adaptive() if settings["persistence"] == "adaptive" else None,
            seed=settings["seed"],
            candidates=default_candidates(search),
            options=options,
        )
        self.instance, self.settings, self.colony, self.playing = instance, settings, colony, False
        self.map = self.map if frame is None else frame
        self.curve: list[tuple[float, float, float]] = []
        return [self.describe()]

    def do_reset(self, message: Message) -> list[Message]:
        return self._restart(self.instance, self.settings)

    def do_instance(self, message: Message) -> list[Message]:
        name = checks.choice("name", message.get("name"), INSTANCES)
        return self._restart(INSTANCES[name](), self.settings, _SQUARE)

    def do_open(self, message: Message) -> list[Message]:
        contents = decoded(message.get("files"))
        for name, data in contents.items():
            if name.lower().endswith((".tsp", ".txt")):
                instance: Tsp = self.work("instance", data, name)
                return self._restart(instance, self.settings, _around(instance))
        raise BadParameter("files", list(contents), "a TSPLIB file .tsp")

    def do_city(self, message: Message) -> list[Message]:
        """Add a city at a point, or remove the one there; x and y are shares of the map's longer side."""
        x, y = checks.point("xy", message.get("xy"))
        near = checks.number("near", message.get("near"), low=0.0, high=0.1)
        xy, (low, size) = self.instance.xy, self.map
        assert xy is not None
        if not (0.0 <= x * size.max() <= size[0] and 0.0 <= y * size.max() <= size[1]):
            raise BadParameter("xy", (x, y), "on the map")
        place = low + np.array((x, y)) * size.max()
        away = np.hypot(*(xy - place).T)
        there = away <= near * size.max()
        added = np.clip(np.round(place, 3), low, low + size)
        changed = np.delete(xy, away.argmin(), axis=0) if there.any() else np.vstack((xy, added))
        if len(changed) < MIN_CITIES:
            raise BadParameter("cities", len(changed), f"{MIN_CITIES} or more")
        return self._restart(Tsp(changed, metric=self.instance.metric, name=self.instance.name), self.settings)

    def do_set(self, message: Message) -> list[Message]:
        value = message.get("value")
        field = checks.choice("field", message.get("field"), self.settings)
        if field == "ants":
            value = checks.integer("ants", value, low=1, high=200)
        elif field == "seed":
            value = checks.integer("seed", value, low=0, high=MAX_PAGE_SEED)
        else:
            value = checks.choice(field, value, {"rule": RULES, "search": SEARCHES, "persistence": PERSISTENCES}[field])
        return self._restart(self.instance, {**self.settings, field: value})

    def do_export(self, message: Message) -> list[Message]:
        """Return the best tour as a file of TSPLIB's TOUR type."""
        checks.choice("what", message.get("what"), ("tour",))
        name, best = stem(self.instance.name), self.colony.best
        heads = (f"NAME : {name}", "TYPE : TOUR", f"DIMENSION : {len(best)}", "TOUR_SECTION")
        lines = (*heads, *map(str, (best + 1).tolist()), "-1", "EOF", "")
        return [as_file(f"{name}.tour", "text/plain", "\n".join(lines))]


def _around(instance: Tsp) -> Frame | None:
    """Return the smallest map with all cities; None without places."""
    if instance.xy is None:
        return None
    size = np.ptp(instance.xy, axis=0)
    return instance.xy.min(axis=0), np.maximum(size, size.max() / 100 or 1.0)
