"""C35, C36: the results file recovers or refuses with the reason; it never loses a row, and never overwrites."""

from __future__ import annotations

import csv
import json
import math
import os
import sqlite3
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from antway.arena.store import COLUMNS, Results, Row, export
from antway.arena.summary import summarise
from antway.errors import BadParameter, BadResults
from antway.world.tracefile import MAX_BYTES
from common import cases


def row(k, policy="antway", **more):
    return Row(
        "synthetic", f"open/low/{k:04d}", policy, 2**62 + k, "0.1.0", "open/low", "reached", "at the goal", 10.0 + k, **more
    )


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "results.db"
    with Results(path) as results:
        for k in range(50):
            results.add(row(k, clearance=math.inf, jerk=0.1), "x" * 5000 if k % 2 else "")
    return path


def test_rows_come_back_as_they_went_in(tmp_path):
    """Rows come back equal, sorted by key, with infinity and NaN; a second row of a key is not taken."""
    rows = [row(k, policy, clearance=math.inf, bound=1 / 3 + k) for k in (3, 1, 2) for policy in ("b", "a")]
    with Results(tmp_path / "r.db") as results:
        for one in rows:
            results.add(one)
        results.add(row(3, "a", clearance=0.0))
        found = results.rows()
    assert [one.key for one in found] == sorted(one.key for one in rows)
    assert [repr(one) for one in found] == [repr(one) for one in sorted(rows, key=lambda one: one.key)]


@pytest.mark.parametrize("seed", [2**63, -1, 0.5, True, None])
def test_a_seed_that_the_file_cannot_hold_is_refused(file, seed):
    """It was an OverflowError from SQLite, or a row that was found damaged later."""
    with pytest.raises(BadParameter, match="seed"):
        replace(row(1), seed=seed)
    with Results(file) as results:
        with pytest.raises(BadParameter, match="row"):
            results.add(row(1).key)
        results.add(replace(row(1), seed=np.int32(7), waits=np.uint8(3)))
        found = next(one for one in results.rows() if one.seed == 7)
        assert found.waits == 3 and type(found.seed) is type(found.waits) is int
        for ask in (results.has, results.trace):
            with pytest.raises(BadResults, match="too large"):
                ask((*row(1).key[:3], 2**63, "0.1.0"))


def test_traces_are_kept_with_their_rows(file):
    """A trace comes back as it was; of a row without one there is none."""
    with Results(file, write=False) as results:
        assert results.trace(row(1).key) == "x" * 5000
        assert results.trace(row(2).key) == ""


def test_a_file_of_another_schema_is_refused_and_left_alone(tmp_path):
    """Other databases, other schemas, other files, empty folders: the typed error, and not a byte changed."""
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as db:
        db.execute("CREATE TABLE mine (x)")
    db.close()
    newer = tmp_path / "newer.db"
    Results(newer).close()
    with sqlite3.connect(newer) as db:
        db.execute("PRAGMA user_version = 99")
    db.close()
    text = tmp_path / "text.db"
    text.write_text("this is not a database, but long enough to look at " * 100)
    short = tmp_path / "short.db"
    short.write_text("x")  # SQLite would take it for an empty file
    shut = "a results file of antway"
    for path, printed in ((other, shut), (newer, "schema 99"), (text, "not a database"), (short, shut)):
        before = path.read_bytes()
        for write in (True, False):
            with pytest.raises(BadResults, match=printed):
                Results(path, write=write)
        assert path.read_bytes() == before
    with pytest.raises(BadResults):
        Results(tmp_path)
    with pytest.raises(BadResults, match="existing"):
        Results(tmp_path / "none.db", write=False)


def test_a_file_of_schema_1_is_brought_up_to_date(file):
    """An older file is refused for reading alone, with a hint; opened for writing its columns are renamed."""
    with Results(file, write=False) as results:
        right = [repr(one) for one in results.rows()]
    with sqlite3.connect(file) as db:
        for old, new in (("flips", "side_changes"), ("survival", "difficulty")):
            db.execute(f"ALTER TABLE episodes RENAME COLUMN {new} TO {old}")
        db.execute("PRAGMA user_version = 1")
    db.close()
    with pytest.raises(BadResults, match="schema 1, which opening it for writing brings up to date"):
        Results(file, write=False)
    for write in (True, False):
        with Results(file, write=write) as results:
            assert [repr(one) for one in results.rows()] == right
            assert results.db.execute("PRAGMA user_version").fetchone()[0] == 2


def test_damage_is_found_or_does_no_harm(file, tmp_path):
    """C35: cut off or with flipped bits a file is refused with the reason, or every row reads as it was written."""
    whole = file.read_bytes()
    rng_state = 12345
    damaged = tmp_path / "damaged.db"
    with Results(file, write=False) as results:
        right = [repr(one) for one in results.rows()]
    for k in range(cases(150, 5000)):
        rng_state = (rng_state * 6364136223846793005 + 1442695040888963407) % 2**64
        at = (rng_state >> 20) % len(whole)
        spoilt = whole[:at] if k % 3 == 0 else whole[:at] + bytes([whole[at] ^ 1 << (rng_state >> 60) % 8]) + whole[at + 1 :]
        for journal in (f"{damaged}-wal", f"{damaged}-shm"):
            if os.path.exists(journal):
                os.unlink(journal)
        damaged.write_bytes(spoilt)
        try:
            with Results(damaged) as results:
                found = [repr(one) for one in results.rows()]
        except BadResults:
            continue
        assert found in (right, []) and (found or not spoilt), f"case {k}: byte {at}"


def test_a_row_that_was_changed_is_refused_before_others_are_added(file):
    """SQLite finds no fault in such a file."""
    with sqlite3.connect(file) as db:
        db.execute("UPDATE episodes SET time = 1.0 WHERE episode = 'open/low/0007'")
    db.close()
    with pytest.raises(BadResults, match=r"open/low/0007.* is not as it was written"):
        Results(file)
    with Results(file, write=False) as results, pytest.raises(BadResults, match="is not as it was written"):
        results.rows()


def test_a_full_disk_is_an_error_and_loses_nothing(file):
    """C35: when no page can be added any more the error says so, and the rows of before are all there."""
    with Results(file) as results:
        pages = results.db.execute("PRAGMA page_count").fetchone()[0]
        results.db.execute(f"PRAGMA max_page_count = {pages}")
        with pytest.raises(BadResults, match="full"):
            for k in range(100, 200):
                results.add(row(k), "".join(chr(33 + (i * i + k) % 90) for i in range(20_000)))
    with Results(file) as results:
        assert len([one for one in results.rows() if one.time < 60.0]) == 50


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anything")
def test_a_read_only_file_is_refused(file):
    """C35: a file that cannot be written is a typed error for who would write, and can be read."""
    file.chmod(0o444)
    file.parent.chmod(0o555)
    try:
        with pytest.raises(BadResults), Results(file) as results:
            results.add(row(99))
    finally:
        file.parent.chmod(0o755)


def test_reading_changes_no_folder(file):
    """Reading leaves no file behind, so that a file in a read-only folder or medium can be read."""
    with Results(file, write=False) as results:
        assert len(results.rows()) == 50
        assert [one.name for one in file.parent.iterdir()] == [file.name]


def test_a_trace_that_unpacks_to_more_than_can_be_read_is_refused(file):
    """A few kilobytes may unpack to gigabytes."""
    with sqlite3.connect(file) as db:
        db.execute("UPDATE episodes SET trace = ?", (zlib.compress(bytes(MAX_BYTES + 1)),))
    with Results(file, write=False) as results, pytest.raises(BadResults, match="has more than"):
        results.trace(row(1).key)


@pytest.mark.parametrize("write", [False, True])
def test_a_name_that_no_file_can_have_is_refused(write, tmp_path):
    """SQLite would take the part before a NUL for the name."""
    with pytest.raises(BadResults):
        Results(f"{tmp_path}/a\0.db", write=write)
    with pytest.raises(BadResults):
        Results(3, write=write)
    assert not list(tmp_path.iterdir())


def test_a_lock_is_waited_for(tmp_path):
    """C35: a write waits while another program holds the file, and then goes through."""
    path = tmp_path / "r.db"
    with Results(path) as results:
        script = (
            f"import sqlite3, sys; db = sqlite3.connect({str(path)!r}, isolation_level=None); db.execute('BEGIN IMMEDIATE');"
            "print('held', flush=True); sys.stdin.readline(); db.execute('COMMIT')"
        )
        with subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
            assert holder.stdout.readline() == b"held\n"
            holder.stdin.write(b"\n")
            holder.stdin.flush()
            results.add(row(1))
        assert len(results.rows()) == 1


def test_two_writers_and_one_killed_in_a_transaction(tmp_path):
    """C36: two writers of the same rows, and a third killed inside a transaction: no row lost, doubled or mixed."""
    script = (
        "import sys; sys.path.insert(0, 'tests'); from test_store import row; from antway.arena.store import Results\n"
        "results = Results(sys.argv[1]); print('ready', flush=True)\n"
        "for k in range(60): results.add(row(k, clearance=0.5), 'trace %d' % k)\n"
    )
    killed = "import os, signal, sqlite3, sys; db = sqlite3.connect(sys.argv[1], timeout=60, isolation_level=None)\n" + (
        "db.execute('BEGIN IMMEDIATE'); db.execute('UPDATE episodes SET time = 0'); os.kill(os.getpid(), signal.SIGKILL)"
    )
    for k in range(cases(1, 20)):
        path = tmp_path / f"{k}.db"
        Results(path).close()
        with (
            subprocess.Popen([sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE) as other,
            Results(path) as results,
        ):
            with subprocess.Popen([sys.executable, "-c", killed, str(path)]) as third:
                assert other.stdout.readline() == b"ready\n"
                for k in range(60):
                    results.add(row(k, clearance=0.5), f"trace {k}")
            assert (other.wait(), third.returncode) == (0, -9)
        with Results(path) as results:
            assert [repr(one) for one in results.rows()] == [repr(row(k, clearance=0.5)) for k in range(60)]
            assert results.trace(row(7).key) == "trace 7"


def test_export(file, tmp_path):
    """CSV, JSON and Parquet hold every row; another suffix is refused."""
    with Results(file, write=False) as results:
        rows = results.rows()
    with export(rows, tmp_path / "r.csv").open(newline="") as table:
        lines = list(csv.reader(table))
    assert lines[0] == list(COLUMNS) and len(lines) == 51 and lines[1][8] == "10.0"
    assert [one["time"] for one in json.loads(export(rows, tmp_path / "r.json").read_text())] == [one.time for one in rows]
    with pytest.raises(BadParameter, match="parquet"):
        export(rows, tmp_path / "r.xls")
    for kind in ("csv", "JSON"):  # in a folder that does not exist
        with pytest.raises(BadParameter, match=r"export = .*: must be a path that can be written to"):
            export(rows, tmp_path / "nofolder" / f"r.{kind}")
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(export(rows, tmp_path / "r.parquet")).column("seed").to_pylist() == [one.seed for one in rows]


def test_json_tells_infinite_from_unknown(tmp_path):
    """An optimum that does not arrive was null, as one that is unknown is."""
    bounds = [10.0, math.inf, math.nan]
    path = export([row(k, bound=bound) for k, bound in enumerate(bounds)], tmp_path / "r.json")
    assert [one["bound"] for one in json.loads(path.read_text())] == [10.0, "inf", None]
    pandas = pytest.importorskip("pandas")
    np.testing.assert_equal(pandas.read_json(path).bound.astype(float).to_numpy(), bounds)


def test_the_recipe_for_pandas_leaves_out_an_optimum_that_does_not_arrive(tmp_path, monkeypatch, capsys):
    """Time over an infinite optimum is 0, which counted; the page's means are those of antway's own table."""
    pandas = pytest.importorskip("pandas")
    rows = [row(k, bound=bound) for k, bound in enumerate([8.0, math.inf, math.nan])]
    (tmp_path / "bench").mkdir()
    export(rows, tmp_path / "bench" / "results.csv")
    monkeypatch.chdir(tmp_path)
    page = Path(__file__).parents[1] / "docs" / "arena.md"
    recipe = page.read_text(encoding="utf-8").partition("With pandas")[2].split("```")[1]
    exec(recipe.removeprefix("python"), {"pandas": pandas})
    assert capsys.readouterr().out.split()[-1] == str(summarise(rows)[0].time_ratio) == "1.25"


def test_numbers_below_zero_and_names_of_odd_letters(tmp_path):
    """Zero with a sign comes back as written; a name that is no text in UTF-8 is a typed error, and spoils nothing."""
    with Results(tmp_path / "r.db") as results:
        results.add(row(0, clearance=-0.0), None)
        with pytest.raises(BadResults):
            results.add(row(1, policy="\udce9"), None)
    with Results(tmp_path / "r.db", write=False) as results:
        assert [one.clearance for one in results.rows()] == [0.0]


def test_rows_are_read_while_others_are_written(tmp_path):
    """A new file has a log of its own for what is written, so that whoever reads it waits for nobody."""
    with Results(tmp_path / "r.db") as results:
        results.add(row(0))
        results.db.execute("BEGIN IMMEDIATE")
        results.add(row(1))
        with Results(tmp_path / "r.db", write=False) as reader:
            assert [one.key for one in reader.rows()] == [row(0).key]
        results.db.execute("COMMIT")
        assert results.db.execute("PRAGMA journal_mode").fetchone()[0] == "wal"
