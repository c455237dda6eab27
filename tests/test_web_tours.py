"""The page of tours: what a session of it does with instances, settings and cycles."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
import pytest

from antway.ants.colony import Colony
from antway.ants.tsplib import Tsp
from antway.errors import BadInput
from antway.web.tours import INSTANCES, Tours
from common import play

FIVE = "NAME : five\nTYPE : TSP\nDIMENSION : 5\nEDGE_WEIGHT_TYPE : EUC_2D\nNODE_COORD_SECTION\n"
FIVE += "".join(f"{i + 1} {x} {y}\n" for i, (x, y) in enumerate([(0, 0), (0, 20), (20, 20), (20, 0), (10, 0)])) + "EOF\n"


def file_of(text: str, name: str = "five.tsp") -> dict[str, str]:
    return {"name": name, "data": base64.b64encode(text.encode()).decode()}


def unpack(text: str, dtype: str) -> Any:
    return np.frombuffer(base64.b64decode(text), dtype)


def test_a_colony_on_the_page_is_the_librarys() -> None:
    """The page's colony gives the tours that the library's gives for that seed."""
    tab, colony = Tours(), Colony(INSTANCES["scattered"](), "mmas", ants=25, seed=0)
    room = np.empty((1, 2))
    for _ in range(30):
        colony.run(1, room)
    tab.apply({"op": "step"})
    play(tab, 29)
    frame = tab.frame()
    assert frame["cycle"] == 30 and (unpack(frame["tour"], "<u2") == colony.best).all()
    assert frame["best"] == pytest.approx(colony.best_cost, abs=1e-3) and len(frame["curve"]) == 30
    assert [row[1] for row in frame["curve"]] == sorted((row[1] for row in frame["curve"]), reverse=True)
    assert tab.frame()["curve"] == []


def test_a_ring_is_solved_and_the_run_ends() -> None:
    """On the ring the optimum is known; the colony finds it, the gap is 0, and playing stops."""
    tab = Tours()
    tab.apply({"op": "instance", "name": "ring"})
    tab.apply({"op": "set", "field": "search", "value": "3opt"})
    tab.apply({"op": "play", "on": True})
    for _ in range(50):
        play(tab, 10)
    frame = tab.frame()
    assert frame["ended"] and not frame["playing"] and frame["gap"] == 0.0
    order = unpack(frame["tour"], "<u2").astype(int)
    assert sorted(order) == list(range(40)) and set(np.abs(np.diff(order)) % 38) == {1}
    printed = tab.apply({"op": "export", "what": "tour"})[0]
    assert printed["text"].splitlines()[2:4] == ["DIMENSION : 40", "TOUR_SECTION"] and printed["text"].endswith("-1\nEOF\n")


def test_frames_of_many_cities_are_small() -> None:
    """With 5,000 cities a frame stays within 60 kB, and its edges are the strongest."""
    tab = Tours()
    rng = np.random.default_rng(0)
    tab._restart(Tsp(rng.uniform(0, 1e4, (5000, 2)), name="many"), tab.settings)
    play(tab, 2)
    tab.colony.state.tau[:] = rng.random(tab.colony.state.tau.shape)
    frame = tab.frame()
    assert len(json.dumps(frame, separators=(",", ":"))) <= 60_000
    ends, amounts = unpack(frame["ends"], "<u2").reshape(-1, 2), unpack(frame["amounts"], "u1")
    assert len(ends) == len(amounts) > 1000 and amounts.min() > 200 and (ends[:, 0] < ends[:, 1]).all()


def test_files_open_and_wrong_requests_change_nothing() -> None:
    """A TSPLIB file opens; wrong files, settings and messages are refused in the library's words and leave the run alone."""
    tab = Tours()
    tab.apply({"op": "open", "files": [file_of(FIVE)]})
    assert tab.instance.name == "five" and tab.describe()["size"] == 5
    play(tab, 3)
    colony = tab.colony
    wrong: list[Any] = [
        None, {"op": "open", "files": []}, {"op": "open", "files": [file_of("NAME : x\n")]},
        {"op": "open", "files": [file_of("", "x.png")]},
        {"op": "open", "files": [file_of(FIVE.replace("EUC_2D", "GEO"))]}, {"op": "set", "field": "ants", "value": 0},
        {"op": "set", "field": "seed", "value": -1}, {"op": "set", "field": "rule", "value": "best"},
        {"op": "speed", "speed": 3},
        {"op": "instance", "name": "../x"}, {"op": "export", "what": "scenario"}, {"op": "play", "on": 1},
    ]  # fmt: skip
    for request in wrong:
        with pytest.raises(BadInput):
            tab.apply(request)
    assert tab.colony is colony and colony.cycle == 3
    for field, value in (("rule", "acs"), ("persistence", "adaptive"), ("search", "2opt"), ("ants", 7), ("seed", 5)):
        tab.apply({"op": "set", "field": field, "value": value})
        play(tab, 2)
        assert tab.settings[field] == value and tab.frame()["cycle"] == 2


def test_cities_are_added_and_removed() -> None:
    """A city is added where the map is pressed and removed where one is; the map keeps its frame, and four cities stay."""
    tab = Tours()
    tab.apply({"op": "open", "files": [file_of(FIVE)]})
    frame = tab.describe()["frame"]
    told = tab.apply({"op": "city", "xy": [0.25, 0.75], "near": 0.02})[0]
    assert told["size"] == 6 and told["frame"] == frame and tab.instance.xy is not None
    assert tab.instance.xy[-1].tolist() == [5.0, 15.0] and tab.instance.metric == "EUC_2D"
    tab.apply({"op": "city", "xy": [0.26, 0.75], "near": 0.02})
    tab.apply({"op": "city", "xy": [0.5, 0.0], "near": 0.02})
    assert tab.instance.size == 4
    for wrong in ({"xy": [0.0, 0.0]}, {"xy": [1.5, 0.5]}, {"xy": [0.5, 0.5], "near": 2}, {"xy": "there"}):
        with pytest.raises(BadInput):
            tab.apply({"op": "city", "near": 0.02, **wrong})
    assert tab.instance.size == 4


def test_a_city_at_the_edge_of_a_small_map_stays_there() -> None:
    """A city's place is rounded, but never off the map, so that the page does not draw it at the opposite edge."""
    tab = Tours()
    places = [(0.1004, 0.2), (0.9996, 0.3), (0.5, 0.9996), (0.4, 0.1004), (0.7, 0.6)]
    cities = "".join(f"{i + 1} {x} {y}\n" for i, (x, y) in enumerate(places))
    tab.apply({"op": "open", "files": [file_of(FIVE[: FIVE.index("1 0")] + cities + "EOF\n")]})
    for share, edge in (([1.0, 0.9], 0.9996), ([0.0, 0.9], 0.1004)):
        told = tab.apply({"op": "city", "xy": share, "near": 0.01})[0]
        assert unpack(told["cities"], "<u2")[-2] == 65535 * share[0] and tab.instance.xy[-1, 0] == edge
