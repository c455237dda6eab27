"""Traces: the file gives back every bit, and damage is refused with the file and key named."""

from __future__ import annotations

import json
import math
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from antway import BadInput, BadScenario, Grid, Outcome, RobotSpec, Task, TimedPath, TooLarge, load_scenario, run
from antway.world import tracefile
from antway.world.policy import Decision
from antway.world.timeline import COLUMNS, Timeline
from antway.world.trace import Trace
from antway.world.tracefile import _pack
from common import cases


def sample(seed: int = 0) -> Trace:
    rng = np.random.default_rng(seed)
    n = 6
    decision = Decision(
        "avoid",
        'a reason with "quotes" and ü',
        obstacle=3,
        local_target=(1.5, 2.0),
        path=TimedPath(np.array([0.0, 1.0]), rng.random((2, 2))),
        alternatives=(("wait", math.inf), ("avoid", np.float32(0.5))),
        pheromone=(1, 2, rng.random((3, 4)).astype(np.float32)),
        history=rng.random((2, 4)),
        predicted=rng.random((2, 7)).astype(np.float32),
    )
    return Trace(
        Task(Grid(rng.random((5, 6)) < 0.3, 0.5), RobotSpec(), (1.0, 1.0), (2.0, 2.0)),
        "paper",
        2**64 - 1,
        "sample",
        np.arange(n + 1) * 0.1,
        rng.random((n + 1, 2)),
        rng.random((n + 1, 2)),
        rng.random(n + 1),
        np.where(rng.random((n, 2)) < 0.2, math.nan, rng.random((n, 2))),
        Timeline.of([3, 9], [0.3, 0.4], [([0, 1, 2.5], [(0, 0), (1, 0), (1, 1)]), ([0], [(3, 3)])]),
        rng.random((n + 1, 2)) < 0.5,
        ((0, Decision("follow", "go")), (3, decision)),
        rng.random(n),
        Outcome.TIMEOUT,
        "why",
        {"horizon": 1.0},
    )


def test_a_trace_has_arrays_of_its_own() -> None:
    """The arrays that were given became read-only; and what is written to them later does not change the trace."""
    given = {
        name: np.array(getattr(sample(), name)) for name in ("t", "xy", "velocity", "heading", "command", "sensed", "cycle_ms")
    }
    trace = replace(sample(), **given, turn_rate=np.zeros(7))
    for name, array in given.items():
        array[:] = 0
        assert np.array_equal(getattr(trace, name), getattr(sample(), name), equal_nan=True)
        assert not getattr(trace, name).flags.writeable


def test_a_file_gives_back_every_bit(tmp_path: Path) -> None:
    """Saved and loaded, every array, decision and number is the same, and the digest with it."""
    trace = sample()
    trace.save(tmp_path / "trace.json", timing=True)
    back = Trace.load(tmp_path / "trace.json")
    for name in (
        "t",
        "xy",
        "velocity",
        "heading",
        "command",
        "sensed",
        "cycle_ms",
        "obstacle_xy",
        "obstacle_id",
        "obstacle_radius",
    ):
        assert getattr(back, name).tobytes() == getattr(trace, name).tobytes(), name
    assert back.digest() == trace.digest() and back.task.grid == trace.task.grid and back.task.robot == trace.task.robot
    assert (back.policy, back.seed, back.scenario, back.outcome, back.config) == (
        "paper",
        2**64 - 1,
        "sample",
        Outcome.TIMEOUT,
        {"horizon": 1.0},
    )
    step, decision = back.decisions[1]
    assert step == 3 and decision.alternatives[0] == ("wait", math.inf) and decision.pheromone[2].dtype == np.float32
    assert decision.pheromone[2].tobytes() == trace.decisions[1][1].pheromone[2].tobytes()
    assert back.decision_at(2).action == "follow" and back.decision_at(5).action == "avoid"
    back.save(tmp_path / "again.json", timing=True)
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "trace.json").read_bytes()
    back.save(tmp_path / "untimed.json")
    assert not Trace.load(tmp_path / "untimed.json").cycle_ms.any() and trace.cycle_ms.any()


def test_what_is_empty_and_a_seed_of_0_come_back(tmp_path: Path) -> None:
    """A motion without knots, a history without cycles and a map of pheromone without cells are read as they were written."""
    empty = Decision(
        "stuck",
        "no path",
        path=TimedPath(np.empty(0), np.empty((0, 2))),
        pheromone=(0, 0, np.empty((0, 3), np.float32)),
        history=np.empty((0, 4)),
        predicted=np.empty((0, 7), np.float32),
    )
    trace = replace(sample(), seed=0, decisions=((0, empty),))
    trace.save(tmp_path / "trace.json")
    back = Trace.load(tmp_path / "trace.json")
    ((_, found),) = back.decisions
    assert back.digest() == trace.digest() and back.seed == 0
    assert found.path is not None and found.path.xy.shape == (0, 2)
    assert found.history is not None and found.history.shape == (0, 4)


@pytest.mark.parametrize("path", [None, 5, b"trace.json"])
def test_what_is_no_path_is_refused(path: object) -> None:
    with pytest.raises(BadScenario, match="a path"):
        Trace.load(path)  # type: ignore[arg-type]


def test_traces_of_version_1_are_read(tmp_path: Path) -> None:
    """Version 1 told of policy antway the time to the goal and its bound: what the plan loses to that is kept."""
    path = tmp_path / "trace.json"
    sample().save(path)
    record = json.loads(path.read_text())
    record["version"] = 1
    record["task"]["robot"]["a_max"] = 2.0  # without turn rates such a robot drove in steps
    record["decisions"][1]["alternatives"] = [["the plan", 8.5], ["no way is faster than", 8.25]]
    path.write_text(json.dumps(record))
    trace = Trace.load(path)
    decision = trace.decisions[1][1]
    assert trace.task.robot == RobotSpec(a_max=2.0, dynamics="steps")
    assert decision.alternatives == (("the plan", 0.25),) and decision.weighed() == [("the plan", "+0.2 s")]


def test_a_digest_sees_every_bit_but_the_clock() -> None:
    """One changed bit changes the digest; the policy's wall time does not."""
    trace = sample()
    same = sample()
    object.__setattr__(same, "cycle_ms", same.cycle_ms + 1)
    assert same.digest() == trace.digest()
    xy = trace.xy.copy()
    xy[2, 0] = np.nextafter(xy[2, 0], 2)
    object.__setattr__(same, "xy", xy)
    assert same.digest() != trace.digest()


def test_damage_is_refused(tmp_path: Path) -> None:
    """Mutated bytes, cut files and wrong values give the typed error or a legal trace, never another exception."""
    path = tmp_path / "trace.json"
    sample().save(path)
    good = path.read_bytes()
    rng = np.random.default_rng(7)
    for _ in range(cases(300, 20_000)):
        data = bytearray(good)
        kind = rng.integers(4)
        at = int(rng.integers(len(data)))
        if kind == 0:
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            del data[at : at + int(rng.integers(1, 50))]
        elif kind == 2:
            data[at:at] = bytes(rng.integers(0, 256, 5).tolist())
        else:
            del data[at:]
        path.write_bytes(data)
        try:
            Trace.load(path)
        except BadInput as error:
            assert str(path) in str(error) or "trace" in str(error)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("alternatives", 5),
        ("alternatives", [["wait", 1.0, 2.0]]),
        ("pheromone", {"0": 1}),
        ("origin", 5),
        ("rounds.stops[0].at[1]", {"at": [1.0, "a"], "name": "desk", "window": [0.0, None], "service": 0.0}),
        ("rounds.stops[0].name", {"at": [1.0, 2.0], "name": 5, "window": [0.0, None], "service": 0.0}),
    ],
)
def test_wrong_lists_are_named(tmp_path: Path, name: str, value: object) -> None:
    """A number in place of a list is not an empty list; a wrong stop is named with its table."""
    path = tmp_path / "trace.json"
    sample().save(path)
    record = json.loads(path.read_text())
    if name.startswith("rounds"):
        record["rounds"] = {"stops": [value], "visits": [], "turns": []}
    elif name == "origin":
        record["task"]["grid"]["origin"] = value
    else:
        record["decisions"][-1][name] = value
    path.write_text(json.dumps(record))
    with pytest.raises(BadInput) as caught:
        Trace.load(path)
    assert name in str(caught.value) and str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("format", "other"),
        *(("version", version) for version in (3, 0, True, 2.0, "2", None)),
        ("t", [0, "a"]),
        ("t", [0.0, 0.1, 0.3, 0.2, 0.4, 0.5, 0.6]),
        ("xy", [[0, 0]]),
        ("outcome", "won"),
        ("seed", -1),
        ("timeline", {"id": [1]}),
        ("sensed", {"dtype": "|b1", "shape": [10**9, 10**9], "zlib": ""}),
        ("sensed", {"dtype": "<f8", "shape": [7, 2], "zlib": ""}),
        ("decisions", [{"step": 0}]),
        ("decisions", 3),
        ("task", None),
    ],
)
def test_wrong_values_are_named(tmp_path: Path, key: str, value: object) -> None:
    """A wrong value raises an error that names the file and the key."""
    path = tmp_path / "trace.json"
    sample().save(path)
    record = json.loads(path.read_text())
    path.write_text(json.dumps(record | {key: value}))
    with pytest.raises(BadInput, match=key) as caught:
        Trace.load(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(
            ("rounds.visits[0]", wrong)
            for wrong in ([1, 0.0, 0.0, 1.0], [-1, 0.0, 0.0, 1.0], [0, 0.0, 1.0], [0, 0.0, "1", 1.0])
        ),
        *(("rounds.turns[0]", wrong) for wrong in ([0.0, [1], ""], [0.0, [-1], ""], [0.0, [0]], ["0", [0], ""], [0.0, [0], 1])),
        *(("rounds.stops[0].window", wrong) for wrong in ([0.0], [2.0, 1.0], 1.0)),
        *(("decisions[1].step", wrong) for wrong in (-1, 7, True, 1.0)),
        *(("decisions[1].path.t", wrong) for wrong in ([0.0], [0.0, "nan"], 1.0)),
        *(("decisions[1].path.xy", wrong) for wrong in ([[0.0, 1.1e10], [0.0, 0.0]], [[0.0], [0.0]])),
        *(("decisions[1].predicted", [[0.0] * 7]), ("decisions[1].predicted", _pack(np.zeros((2, 6), np.float32)))),
        ("decisions[1].predicted", _pack(np.full((1, 7), math.nan, np.float32))),
        *(("decisions[1].history", [[0.0] * 3]), ("decisions[1].obstacle", 1.5), ("decisions[1].gap", "far")),
        *(
            ("config.horizon", -1.0),
            ("config.sensor", []),
            ("config.sensor", {"occlusion": 1}),
            ("timeline.radius", [0.3, 0.0]),
            ("timeline.radius", [0.3, 1.1e10]),
            ("timeline.knot_xy", [[0.0, -1.1e10], [1.0, 0.0], [1.0, 1.0], [3.0, 3.0]]),
        ),
        *(("heading", [0.0] * 6), ("heading", [1.1e10] * 7), ("command", [[0.0, 0.0]] * 7), ("turn_rate", [0.0] * 6)),
        *(("cycle_ms", [0.0] * 7), ("task.robot.drive", 1), ("task.robot.dt", 0.0), ("task.robot.latency", "long")),
    ],
)
def test_wrong_parts_are_named(tmp_path: Path, key: str, value: object) -> None:
    """Wherever they are; a visit is of one of the stops, and a decision of one of the steps."""
    path = tmp_path / "trace.json"
    sample().save(path)
    record = json.loads(path.read_text())
    stops = [{"at": [1.0, 2.0], "name": "desk", "window": [0.0, None], "service": 0.0}]
    record["rounds"] = {"stops": stops, "visits": [[0, 0.0, 0.0, 1.0]], "turns": [[0.0, [0], "first"]]}
    path.write_text(json.dumps(record))
    assert Trace.load(path).rounds is not None
    *way, last = [int(part) if part.isdecimal() else part for part in re.findall(r"\w+", key)]
    part = record
    for name in way:
        part = part[name]
    part[last] = value
    path.write_text(json.dumps(record))
    with pytest.raises(BadInput) as caught:
        Trace.load(path)
    assert re.search(rf"trace\.json: (task\.)?{re.escape(key.removesuffix('.t').removesuffix('.xy'))}", str(caught.value))


@pytest.mark.parametrize("wrong", ["inf", "nan", 1e300, 2**53 + 1, 0.5])
def test_numbers_of_obstacles_are_integers(tmp_path: Path, wrong: object) -> None:
    """Those that no integer of 64 bits holds used to become others, with a warning of NumPy."""
    path = tmp_path / "trace.json"
    sample().save(path)
    record = json.loads(path.read_text())
    record["timeline"]["id"][0] = wrong
    path.write_text(json.dumps(record))
    with pytest.raises(BadScenario, match=r"trace\.json: timeline\.id .*integers"):
        Trace.load(path)


def test_no_file_is_a_typed_error(tmp_path: Path) -> None:
    """A missing file, a folder and deep nesting are refused."""
    (tmp_path / "deep.json").write_text("[" * 100_000)
    (tmp_path / "list.json").write_text("[]")
    for name in ("none.json", ".", "deep.json", "list.json"):
        with pytest.raises(TooLarge if name == "deep.json" else BadScenario):
            Trace.load(tmp_path / name)


FIRST = [0, 2], [1, 1, 2], [0, 1, 1], [0, 0, 2], [0, 2, 1], [0, 1, 3], [0.0, 0.5, 2.0]


def test_timelines_hold_arrays_for_kernels() -> None:
    """Contiguous, of the types that kernels take, and read-only, whatever is given; times may fall from disc to disc."""
    line = Timeline([7, 9], [1, 2], [0, 2, 1], np.asfortranarray([[0, 0], [4, 0], [5, 6]]), (0, 2, 3))
    for name, kind in COLUMNS.items():
        array = getattr(line, name)
        assert array.dtype == kind and array.flags.c_contiguous and not array.flags.writeable, name
    assert line.at(0.5)[0].tolist() == [[1.0, 0.0], [5.0, 6.0]] == line.places(np.array([0.5]))[0].tolist()
    assert line.at(0.5)[1].tolist() == [[2.0, 0.0], [0.0, 0.0]] and len(line) == 2
    other = line.with_trajectories({1: line.trajectory(0)})
    assert other.id.tolist() == [7, 9] and other.at(0.5)[0].tolist() == [[1.0, 0.0]] * 2
    assert len(Timeline.of([], [], [])) == 0 == Timeline.of([], [], []).at(1.0)[0].size


def test_timelines_refuse_what_does_not_fit() -> None:
    """Ids twice, radii not above 0, times that do not increase and misfit arrays are refused."""
    knots = [([0.0, 1.0], [(0, 0), (1, 0)])]
    for wrong in (
        lambda: Timeline.of([1, 1], [0.3, 0.3], knots * 2),
        lambda: Timeline.of([1], [0.0], knots),
        lambda: Timeline.of([1], [0.3], [([1.0, 1.0], [(0, 0), (1, 0)])]),
        lambda: Timeline.of([1], [0.3], [([0.0, math.nan], [(0, 0), (1, 0)])]),
        lambda: Timeline.of([1], [0.3], [([0.0], [(0, 0), (1, 0)])]),
        lambda: Timeline.of([1], [0.3], [([], [])]),
        lambda: Timeline.of([1, 2], [0.3, 0.3], [([0.0, 1.0], [(0, 0)]), ([0.0], [(0, 0), (1, 0)])]),
        *(lambda id=id: Timeline.of([id], [0.3], knots) for id in (0.5, math.nan, 2**63, "a", None)),
        lambda: Timeline.of([1], ["a"], knots),
        *(lambda radius=radius: Timeline.of([1], [radius], knots) for radius in (-0.1, math.nan, math.inf)),
        lambda: Timeline.of([1, 2], [0.3], knots * 2),
        lambda: Timeline.of([1], [0.3], [([0.0, 1.0], [(0, 0), (math.inf, 0)])]),
        *(lambda first=first: Timeline([1, 2], [0.3, 0.3], [0.0, 1.0], [(0, 0), (1, 0)], first) for first in FIRST),
        lambda: Timeline([1], [0.3], [0.0, 1.0], [(0, 0, 0), (1, 0, 0)], [0, 2]),
    ):
        with pytest.raises(BadScenario, match="timeline"):
            wrong()


@pytest.mark.parametrize(
    ("limit", "most", "words"),
    [
        ("MAX_BYTES", lambda text: len(text), "bytes"),
        ("MAX_LISTS", lambda text: text.count("[") + text.count("{"), "lists and tables"),
        ("MAX_UNPACKED", lambda text: 30 + 14 + 4 * (12 + 14), "bytes unpacked"),  # map, sensed, pheromone and predicted
    ],
)
def test_a_trace_that_cannot_be_read_again_is_written_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, most: Callable[[str], int], words: str
) -> None:
    """Nothing said that what was written of 200,000 steps is refused; below the limit it is read, and nothing is said."""
    file, trace = tmp_path / "trace.json", sample()
    trace.save(file)
    allowed = most(file.read_text())
    monkeypatch.setattr(tracefile, limit, allowed)
    with warnings.catch_warnings(action="error"):
        trace.save(file)
    assert Trace.load(file).digest() == trace.digest()
    monkeypatch.setattr(tracefile, limit, allowed - 1)
    with pytest.warns(UserWarning, match=f"more than {allowed - 1} {words}, {allowed}"):
        trace.save(file)
    with pytest.raises(TooLarge):
        Trace.load(file)


def test_a_trace_shows_itself_in_one_line() -> None:
    """The usual text of a dataclass had 294 kB."""
    trace = run(replace(load_scenario("paper"), horizon=1.0), "stop").trace
    assert trace is not None
    assert repr(trace) == "Trace('paper', policy 'stop', 10 steps in 1.00 s: timeout)"
