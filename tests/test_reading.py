"""Files of others cost no more than their budget says, and whatever is in them ends in a value or in a `BadInput`."""

from __future__ import annotations

import base64
import importlib
import json
import os
import re
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from antway import BadInput, BadParameter, BadScenario, TooLarge, load_scenario, load_tsp, load_tsptw
from antway.ants.tsplib import MAX_CITIES, MAX_LINES
from antway.ants.tsplib import parse as parse_tsp
from antway.arena.environments import read_tracks, tracks, walks
from antway.limits import MAX_TABLES
from antway.reading import Unpacked, check_nesting, decoded, numbers_in
from antway.tours.time_windows import parse as parse_tsptw
from antway.view import write_view
from antway.world.robots import load_robot
from antway.world.trace import Trace
from antway.world.tracefile import MAX_UNPACKED, to_json
from sample import sample_trace


def test_traces_unpack_no_more_than_one_budget(tmp_path):
    """D6: many small parts of a trace, each within its limit, are refused once they are too much together."""
    record = json.loads(to_json(sample_trace(steps=6)))
    side = 2000
    packed = {"dtype": "<f4", "shape": [side, side], "zlib": base64.b64encode(zlib.compress(bytes(4 * side * side))).decode()}
    one = next(d for d in record["decisions"] if d["pheromone"])
    record["decisions"] = [one | {"pheromone": [0, 0, packed]} for _ in range(MAX_UNPACKED // (4 * side * side) + 1)]
    path = tmp_path / "bomb.json"
    path.write_text(json.dumps(record))
    assert path.stat().st_size < 2**20
    with pytest.raises(TooLarge, match="unpacked"):
        Trace.load(path)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 1500 + "]" * 1500,
        "[" + "[]," * 1_000_001 + "0]",
        '{"a":' * 100 + "1" + "}" * 100,
        '["]",' * 33 + "1" + "]" * 33,  # brackets in strings close none
        '["\\"]",' * 33 + "1" + "]" * 33,
    ],
)
def test_deep_and_swarming_json_is_refused_before_it_is_parsed(tmp_path, text):
    """D6: an empty list costs twenty times its text in memory."""
    (tmp_path / "t.json").write_text(text)
    with pytest.raises(TooLarge):
        Trace.load(tmp_path / "t.json")


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    "text",
    [
        "a" * 10**6,
        "a" + " " * 10**6,
        '"' * 10**6,
        "a.b " * 250_000,
        "a." * 10**6,
        '\\"' * 500_000,
        '"a\n' * 300_000,
        '"""' + "'''" * 300_000,
    ],
)
def test_the_time_of_reading_toml_grows_with_its_length_alone(text, tmp_path):
    """A search for keys of many parts took minutes where a word was long, because it began anew at each of its letters."""
    (tmp_path / "robot.toml").write_text(text[: 2**20])
    with pytest.raises((TooLarge, BadScenario)) as caught:
        load_robot(tmp_path / "robot.toml")
    assert len(str(caught.value)) < 1000, "a message shows little of a long key"


@pytest.mark.parametrize("text", ['"]",', "']',", '"""]""""",', "''']''',", '"\\"]",', "'\\', "])
def test_brackets_in_strings_of_toml_close_none(text, tmp_path):
    """A message about what is nested more deeply used to end with a RecursionError."""
    for depth, error, says in ((31, BadParameter, "corners"), (400, TooLarge, "depth")):
        (tmp_path / "robot.toml").write_text("footprint = " + f"[{text}" * depth + "]" * depth)
        with pytest.raises(error, match=says):
            load_robot(tmp_path / "robot.toml")


def test_tables_of_toml_are_counted_before_they_are_made(tmp_path):
    """A table takes a hundred times its bytes; rows of lists are no tables."""
    for head in ("[a{}.b]", '["a,{}"]', "[['a]{}']]  # of some"):
        (tmp_path / "swarm.toml").write_text("".join(head.format(k) + "\n" for k in range(MAX_TABLES + 1)))
        with pytest.raises(TooLarge, match="tables"):
            load_scenario(tmp_path / "swarm.toml")
    (tmp_path / "rows.toml").write_text("points = [\n" + "  [1.0, 2.0],\n" * 50_000 + "  [1.0, 2.0]\n]\n")
    with pytest.raises(BadScenario, match="points"):
        load_scenario(tmp_path / "rows.toml")


def test_tsplib_files_of_endless_short_lines_are_refused():
    """D6: so do short lines."""
    head = b"NAME : a\nTYPE : TSP\nDIMENSION : 5\nEDGE_WEIGHT_TYPE : EUC_2D\nNODE_COORD_SECTION\n"
    with pytest.raises(TooLarge, match="lines"):
        parse_tsp(head + b"1\n" * (MAX_LINES + 1))
    assert MAX_LINES >= 4 * MAX_CITIES, "an instance of the size allowed has room"


@pytest.mark.parametrize("text", [b"3 1 2 x", b"2 1_0 2 3 4 5 6 7 8", b"1 2 3", b"", b"#\n", b"1e3 4", b"2 " + b"1 " * 9])
def test_malformed_instances_with_time_windows_are_refused(text):
    """Words that are no numbers, underscores that Python would take, too few and too many."""
    with pytest.raises(BadInput):
        parse_tsptw(text)


def test_numbers_are_read_a_block_at_a_time():
    """Blocks end between numbers, and what comes out is what Python reads of the whole text."""
    rng = np.random.default_rng(5)
    values = rng.normal(size=200_000) * 10.0 ** rng.integers(-5, 5, 200_000)
    text = " ".join(map(repr, values.tolist())).encode()
    assert len(text) > 3 * 2**20
    np.testing.assert_array_equal(numbers_in(text, 200_000, ""), values)
    with pytest.raises(BadInput, match="at most 10"):
        numbers_in(text, 10, "")


@pytest.mark.parametrize("loader", [load_tsp, load_tsptw, load_scenario, Trace.load, read_tracks, None])
@pytest.mark.parametrize("name", ["absent.toml", "folder.toml", "pipe.toml", "x" * 300 + ".toml", "nul\0.toml"])
def test_what_is_no_file_is_a_typed_error_at_once(loader, name, tmp_path):
    """A folder, a pipe that would block, a name that no file can have."""
    (tmp_path / "folder.toml").mkdir()
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(BadInput):
        (loader or load_robot)(str(tmp_path / name))


@pytest.mark.parametrize("data", [b"\xff\xfe", b"t,id,x,y\n\xff", b"\x00\x01"])
@pytest.mark.parametrize("loader", [load_tsp, load_tsptw, load_scenario, Trace.load, read_tracks])
def test_what_is_no_text_is_a_typed_error(loader, data, tmp_path):
    """Bytes that are no UTF-8 are refused by every reader of text."""
    path = tmp_path / "file.csv"
    path.write_bytes(data)
    with pytest.raises(BadInput):
        loader(str(path))


@pytest.mark.parametrize(
    "change",
    [
        lambda r: r["config"].update(sensor=None),
        lambda r: r["config"].update(sensor={"occlusion": "yes"}),
        lambda r: r["config"].update(horizon="inf"),
        lambda r: next(d for d in r["decisions"] if d["path"])["path"]["xy"].__setitem__(0, ["inf", 0.0]),
        lambda r: next(d for d in r["decisions"] if d["path"])["path"]["t"].__setitem__(0, "nan"),
        lambda r: r["xy"].__setitem__(0, [1e300, 0.0]),
    ],
    ids=["no sensor", "sensor of words", "horizon", "infinite path", "NaN in a path", "far away"],
)
def test_traces_with_absurd_parts_are_refused_before_they_are_drawn(change, tmp_path):
    """D9: `antway view` shows no traceback for them."""
    record = json.loads(to_json(sample_trace(steps=30)))
    change(record)
    (tmp_path / "t.json").write_text(json.dumps(record))
    with pytest.raises(BadInput):
        write_view(tmp_path / "t.json", tmp_path / "t.html")


def test_tracks_far_away_are_refused(tmp_path):
    """D9: a place of 1e30 m is none."""
    (tmp_path / "t.csv").write_text("t,id,x,y\n0,1,0,0\n1,1,1e30,0\n")
    with pytest.raises(BadScenario):
        tracks(str(tmp_path / "t.csv"))
    (tmp_path / "t.csv").write_text("t,id,x,y\n0,1,0,0\n1,1,1e9,0\n")
    with pytest.raises(TooLarge):
        tracks(str(tmp_path / "t.csv"))


def test_a_heading_may_be_left_out(tmp_path):
    """The first line of a recording is a heading or the first row."""
    plain = "t,id,x,y\n", "", "# t,id,x,y\n", "# by hand, t in s\n# or so\n", "# by hand\nt,id,x,y\n"
    for heading in (*plain, "  # by hand\nt,id,x,y\n", "t,id,x,y # in s and m\n", "1,1,1,0 # a row\n"):
        for one in ("1e0", "1.0E+00"):
            (tmp_path / "t.csv").write_text(f"{heading}{one},1,1,0\n0,1,0,0\n")
            assert read_tracks(str(tmp_path / "t.csv")).tolist() == [[0.0, 1.0, 0.0, 0.0], [1.0, 1.0, 1.0, 0.0]]


def test_recordings_are_not_cut_short(monkeypatch, tmp_path):
    """A recording with more rows than the limit is refused, not read up to there."""
    monkeypatch.setattr("antway.arena.environments.MAX_ROWS", 3)
    (tmp_path / "t.csv").write_text("0,1,0,0\n1,1,1,0\n2,1,2,0\n")
    assert len(read_tracks(str(tmp_path / "t.csv"))) == 3
    (tmp_path / "t.csv").write_text("0,1,0,0\n1,1,1,0\n2,1,2,0\n3,1,3,0\n")
    with pytest.raises(TooLarge, match="at most 3 rows"):
        read_tracks(str(tmp_path / "t.csv"))


@pytest.mark.parametrize(("text", "says"), [("1," * 10_000, "letters"), ("1" * 10**6, "letters"), ("\n" * 2000, "2000 lines")])
def test_recordings_of_long_lines_or_endless_empty_ones_are_refused(text, says, tmp_path, monkeypatch):
    """They took up to 700 MB, or many seconds, before they were refused."""
    monkeypatch.setattr("antway.arena.environments.MAX_ROWS", 1000)
    (tmp_path / "t.csv").write_text("t,id,x,y\n" + text)
    with pytest.raises(BadScenario, match=says):
        read_tracks(str(tmp_path / "t.csv"))


def test_who_walks_to_and_fro_is_not_taken_for_slow(tmp_path, recwarn):
    """He comes to little in an hour, but his times are in s."""
    rows = [f"{0.2 * k:.1f},{person},{1 + 6 * abs(0.2 * k / 6 % 2 - 1):.3f},{person}" for k in range(290) for person in "0123"]
    (tmp_path / "guards.csv").write_text("\n".join(rows))
    assert len(walks(read_tracks(str(tmp_path / "guards.csv")), "guards.csv")) == 4 and not recwarn.list


def test_equal_rows_of_a_recording_count_once(tmp_path):
    """Two places of somebody at one time are refused by name."""
    (tmp_path / "t.csv").write_text("0,1,0,0\n0,1,0,0\n1,1,1,0\n")
    assert read_tracks(str(tmp_path / "t.csv")).tolist() == [[0.0, 1.0, 0.0, 0.0], [1.0, 1.0, 1.0, 0.0]]
    (tmp_path / "t.csv").write_text("0,1,0,0\n0,1,0,5\n1,1,1,0\n")
    with pytest.raises(BadScenario, match="two places of id 1 at 0 s"):
        read_tracks(str(tmp_path / "t.csv"))


def test_far_places_of_a_recording_begin_at_0(tmp_path):
    """UTM coordinates are too far away for an episode."""
    (tmp_path / "t.csv").write_text("0,1,512345,5412345.5\n1,1,512346,5412345\n")
    assert read_tracks(str(tmp_path / "t.csv"))[:, 2:].tolist() == [[0.0, 0.5], [1.0, 0.0]]


def test_the_step_of_frames(tmp_path):
    """It is the most frequent one; where people then walk at a tenth of their speed, a warning says so."""
    rows = [f"{10 * k} 1 {0.5 * k} 0\n" for k in range(12)]
    (tmp_path / "t.txt").write_text("".join([*rows, "3 2 0 0\n", "13 2 1 1\n", "14 2 2 2\n"]))
    assert read_tracks(str(tmp_path / "t.txt"))[:12, 0] == pytest.approx(0.4 * np.arange(12))
    (tmp_path / "t.txt").write_text("".join(f"{k} 1 {0.05 * k} 0\n" for k in range(100)))
    with pytest.warns(UserWarning, match=r"0\.12 m/s"):
        tracks(str(tmp_path / "t.txt"))


def test_what_is_odd_in_a_recording_is_told(tmp_path):
    """Pixels, numbers that are swapped, and the row that lacks a place."""
    file = tmp_path / "t.csv"
    file.write_text("".join(f"{0.4 * k},1,{20 * k},{k % 3}\n" for k in range(50)))
    with pytest.raises(TooLarge, match="x and y are in m"):
        tracks(str(file))
    with pytest.warns(UserWarning, match=r"50 m/s.*places in m"):
        walks(read_tracks(str(file)), str(file))
    file.write_text(
        "".join(f"{0.4 * k},{i},{0.5 * k},{9 * (i == 1) if k < 9 else 9 * (i == 2)}\n" for i in (1, 2) for k in range(20))
    )
    with pytest.warns(UserWarning, match="2 steps are over 1 m long"):
        tracks(str(file))
    file.write_text('t,id,x,y\n"0","1","0","0"\n"0.4","1","nan","0"\n')
    with pytest.raises(BadScenario, match=r"tracks, line 3 = \[0\.4, 1\.0, nan, 0\.0\]"):
        read_tracks(str(file))
    file.write_text("# a recording\n\nt,id,x,y\n0,1,0,0\n\n# pause\n0.4,1,,0\n0.8,1,1,0\n")
    with pytest.raises(BadScenario, match=r"tracks, line 7 = \"could not convert string '' to float64\": "):
        read_tracks(str(file))


def test_columns_of_a_recording_are_found_by_name(tmp_path):
    """A heading names the columns, in any order and among others; one that lacks a name is refused, not guessed."""
    (tmp_path / "t.csv").write_text('id, t ,"x",y,speed\n7,0.0,1.0,2.0,9\n7,0.4,1.5,2.5,9\n')
    assert read_tracks(str(tmp_path / "t.csv")).tolist() == [[0.0, 7.0, 1.0, 2.0], [0.4, 7.0, 1.5, 2.5]]
    (tmp_path / "t.csv").write_text("frame,id,x,z\n0,1,0,0\n1,1,1,0\n")
    with pytest.raises(BadScenario, match=r"a heading without t, y.*t,id,x,y"):
        read_tracks(str(tmp_path / "t.csv"))


def test_recordings_of_four_columns(tmp_path):
    """Frame, id, x, y, as the sets of those who predict paths have them: frames are 0.4 s apart."""
    (tmp_path / "zara.txt").write_text("780\t1\t8.4\t3.5\n790\t1\t9.1\t3.6\n790\t2\t0.0\t0.0\n800\t2\t0.5\t0.0\n")
    found = read_tracks(str(tmp_path / "zara.txt"))
    assert found == pytest.approx(np.array([(0.0, 1, 8.4, 3.5), (0.4, 1, 9.1, 3.6), (0.4, 2, 0.0, 0.0), (0.8, 2, 0.5, 0.0)]))


def test_budgets_add_up():
    """Parts count together, and what is refused takes nothing."""
    budget = Unpacked(10)
    budget.take("a", 6)
    with pytest.raises(TooLarge):
        budget.take("b", 5)
    budget.take("c", 4)
    with pytest.raises(TooLarge):
        check_nesting("[[[", 2, 10, "")
    with pytest.raises(BadInput):
        decoded(b"\xff", "")


RUN = """
import sys
from antway.cli import main
for file in sys.argv[1:]:
    sys.argv = ["antway", "run", file, "--policy", "stop"]
    try:
        main()
    except SystemExit as ended:
        print("status", ended.code)
"""


def test_names_are_printed_as_they_are(tmp_path):
    """D9: neither markup in a scenario's name nor a locale that lacks its letters ends in a traceback."""
    (tmp_path / "m.txt").write_text("\n".join(["." * 10] * 10) + "\n")
    names = ["[/x]", "[bold]", "café", "\U0001f916 [link=x]"]
    for k, name in enumerate(names):
        text = f'name = "{name}"\nmap = "m.txt"\nstart = [1.5, 1.5]\ngoal = [8.5, 8.5]\nhorizon = 1.0\n'
        (tmp_path / f"{k}.toml").write_text(text, encoding="utf-8")
    plain = {**os.environ, "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-c", RUN, *(str(tmp_path / f"{k}.toml") for k in range(len(names)))]
    done = subprocess.run(command, capture_output=True, text=True, encoding="ascii", env=plain)
    *printed, rest = done.stdout.split("status 4\n")  # the horizon came first
    assert len(printed) == len(names) and not rest, done.stderr
    assert all(name.encode("ascii", "backslashreplace").decode()[:6] in text for name, text in zip(names, printed))


def test_the_table_of_limits_is_that_of_the_code():
    """Each row of docs/limits.md names a number in the code, and says what it is."""
    text = (Path(__file__).parents[1] / "docs" / "limits.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| [^|]+ \| ([^|]+) \| `([\w.]+)\.(\w+)` \|$", text, re.MULTILINE)
    assert len(rows) >= 30
    for value, module, name in rows:
        if module.startswith("web."):
            pytest.importorskip("starlette", reason="the extra web is not installed")
        assert float(value) == getattr(importlib.import_module(f"antway.{module}"), name), name


def test_a_long_key_is_shortened_in_the_message(tmp_path):
    """A key of two million letters made a message of as many."""
    (tmp_path / "long.toml").write_text('"' + "\\u0041" * 200_000 + '" = 1\n')
    with pytest.raises(BadScenario) as caught:
        load_scenario(tmp_path / "long.toml")
    assert len(str(caught.value)) < 1000
