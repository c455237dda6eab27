"""C31, C34, C36, C37: the runner loses no finished episode and gives the same rows however it is run."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import threading
import time
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from antway.arena import engines
from antway.arena.engines import Job, _Worker, bench, local, table_jobs
from antway.arena.store import Results, Row
from antway.arena.suites import episodes
from antway.arena.summary import markdown, paired, ranked, sections, summarise
from antway.baselines.replan import Follow
from antway.cli import main
from antway.errors import BadParameter, BadResults
from antway.processes import uninterrupted
from antway.world.options import take_options
from antway.world.policy import Command, make_policy
from common import SCALE, cases

POLICIES = ["follow", "sipp/predictions=mirrored"]


class Crashes(Follow):
    """Ends its process in the middle of an episode."""

    def act(self, observation):
        if observation.t > 0.5:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)


class Hangs(Follow):
    """Never answers."""

    def act(self, observation):
        time.sleep(3600)


class Counts(Follow):
    """Leaves a line in the file begun.txt of the working directory for each episode that it begins."""

    def reset(self, task, seed):
        super().reset(task, seed)
        with open("begun.txt", "a") as file:
            file.write(f"{seed}\n")


class Draws(Follow):
    """Draws from the global random states."""

    def act(self, observation):
        vx, vy = super().act(observation).velocity
        share = random.random() * np.random.random()  # noqa: NPY002
        return Command((vx * share, vy * share))


class Prints(Follow):
    """Prints when it begins."""

    def reset(self, task, seed):
        super().reset(task, seed)
        print("I begin")


class Raises(Follow):
    """Fails at the first look."""

    def act(self, observation):
        raise RuntimeError("no idea")


class Tarries(Follow):
    """Takes its time before it begins."""

    def reset(self, task, seed):
        time.sleep(1.5)
        super().reset(task, seed)


def same(file):
    """All rows without their timing, as text."""
    with Results(file, write=False) as results:
        return [repr(replace(row, cycle_p50=0.0, cycle_p99=0.0, cycle_max=0.0)) for row in results.rows()]


@pytest.fixture(scope="module")
def jobs():
    few = cases(9, 250)
    return table_jobs(episodes("synthetic", 1 + few // 18)[:few], POLICIES)


@pytest.fixture(scope="module")
def alone(jobs, tmp_path_factory):
    """Rows of one worker in order, against which all others are held."""
    file = tmp_path_factory.mktemp("alone") / "r.db"
    with Results(file) as results:
        bench(jobs, results)
    return same(file)


@pytest.mark.parametrize("workers", [2, 8] if SCALE == 1 else [2, 8, 16])
def test_workers_and_order_change_nothing(jobs, alone, tmp_path, workers):
    """C31: 2, 8 and 16 workers on shuffled jobs give the rows of one worker in order, timing apart."""
    shuffled = list(jobs)
    random.Random(workers).shuffle(shuffled)
    with Results(tmp_path / "r.db") as results:
        bench(shuffled, results, workers=workers)
    assert same(tmp_path / "r.db") == alone


def test_a_million_episodes_take_no_memory_before_they_are_played():
    """They are made one at a time, in the order of number, group and policy."""
    few, many = (table_jobs(episodes("synthetic", count), POLICIES) for count in (3, 1_000_000))
    assert list(few) == list(many[: len(few)]) and len(many) == len(few) * 1_000_000 // 3
    assert [job.policy for job in few[:2]] == POLICIES and many[-1].episode.number == 999_999
    assert [job.episode for job in few[::2]] == list(episodes("synthetic", 3))
    assert [job.key for job in reversed(few)] == [job.key for job in few][::-1]


def test_a_trace_that_could_not_be_read_again_is_not_kept(monkeypatch):
    """The report would end with an error at it, after all episodes had been played."""
    job = Job(episodes("synthetic", 1)[0], "stop")
    row, trace = engines.play(job)
    monkeypatch.setattr("antway.world.tracefile.MAX_LISTS", 3)
    again, none = engines.play(job)
    assert row.outcome == again.outcome != "reached" and trace and not none


def words(out, *more, suite="synthetic"):
    """What follows `antway bench`."""
    return [suite, "--episodes", "1", "--policies", "follow", "--workers", "2", "--out", str(out), *more]


def command(out, *more):
    """A process of `antway bench`."""
    start = f"import sys; sys.path.append({str(Path(__file__).parent)!r}); from antway.cli import main; main()"
    return [sys.executable, "-c", start, "bench", *words(out, *more)]


def run_bench(monkeypatch, *line):
    """Run antway bench in this process; return its exit status."""
    monkeypatch.setattr(sys, "argv", ["antway", "bench", *line])
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def test_kill_and_resume(tmp_path, monkeypatch):
    """C34: killed at random moments and begun again until done, a run has the rows of one left alone; little is redone."""
    whole, broken, kills = tmp_path / "whole", tmp_path / "broken", cases(2, 50)
    counted = ("--policies", "test_bench:Counts", "--episodes", str(1 + kills // 6))
    for folder in (whole, broken):
        folder.mkdir()
    monkeypatch.chdir(whole)
    assert run_bench(monkeypatch, *words(whole, *counted)) == 0
    total = count(whole)
    monkeypatch.chdir(broken)
    rng, kept = random.Random(5), 0
    for _ in range(kills):
        with subprocess.Popen(command(broken, *counted), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as one:
            started, wanted = time.monotonic(), min(kept + rng.randint(1, 4), total - 1)
            while one.poll() is None and time.monotonic() < started + 120 and count(broken) < wanted:
                time.sleep(0.1)  # to look takes milliseconds
            one.kill()
        assert count(broken) >= kept, "a finished episode was lost"
        kept = count(broken)
    assert kept > 0
    assert run_bench(monkeypatch, *words(broken, *counted)) == 0
    assert same(broken / "results.db") == same(whole / "results.db")
    started = (broken / "begun.txt").read_text().splitlines()
    assert len((whole / "begun.txt").read_text().splitlines()) == total == len(set(started))
    assert len(started) <= total + 2 * kills, "more than one episode a worker was redone"
    assert (broken / "report.html").is_file() and (broken / "results.csv").is_file()


def count(folder):
    try:
        with Results(folder / "results.db", write=False) as results:
            return len(results.rows())
    except BadResults:
        return 0


def test_two_runs_on_one_file(tmp_path, monkeypatch):
    """C36: two runs on one file at once do each other no harm; every episode is there once."""
    for k in range(cases(1, 20)):
        out = tmp_path / str(k)
        with subprocess.Popen(command(out), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as other:
            while other.poll() is None and count(out) < 1:
                time.sleep(0.1)
            assert run_bench(monkeypatch, *words(out)) == 0
            _, printed = other.communicate()
            assert other.returncode == 0, printed
        assert count(out) == 18 and same(out / "results.db") == same(tmp_path / "0" / "results.db")


def test_a_bad_policy_costs_its_own_episodes_alone(tmp_path):
    """C37: a policy that kills its process, hangs or raises is a row that says so; the others' rows are as ever."""
    few = episodes("synthetic", 1)[:1]
    jobs = [Job(one, name) for one in few for name in ("test_bench:Crashes", "follow", "test_bench:Hangs", "test_bench:Raises")]
    with Results(tmp_path / "r.db") as results:
        bench(jobs, results, workers=2, timeout=8.0)
        by = {(row.policy, row.episode): row for row in results.rows()}
    assert len(by) == len(jobs)
    for one in few:
        crashed, hung, raised = (by[f"test_bench:{kind}", one.name] for kind in ("Crashes", "Hangs", "Raises"))
        assert crashed.outcome == "error" and "-9" in crashed.reason and math.isnan(crashed.time)
        assert hung.outcome == "timeout" and "8 s of wall time" in hung.reason
        assert raised.outcome == "error" and "RuntimeError: no idea" in raised.reason
        assert by["follow", one.name].outcome not in ("error", "timeout")


def test_interrupt_ends_soon_and_leaves_a_sound_file(tmp_path):
    """C37: Ctrl-C ends a run with status 130, its workers with it, and the file goes on."""
    out = tmp_path / "stopped"
    with subprocess.Popen(
        command(out, "--episodes", "50"),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        # whoever runs the tests in the background may have had Ctrl-C ignored, and children inherit that
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as one:
        while one.poll() is None and count(out) < 2:
            time.sleep(0.1)
        one.send_signal(signal.SIGINT)
        assert one.wait(timeout=60) == 130
    with Results(out / "results.db") as results:
        assert len(results.rows()) >= 2


def test_json_and_the_table(tmp_path, monkeypatch, capfd):
    """--json prints one object on stdout and nothing else; a second run plays nothing again."""
    for _ in range(2):
        assert run_bench(monkeypatch, *words(tmp_path / "b", "--json", "--export", "csv,parquet", "--workers", "1")) == 0
        record = json.loads(capfd.readouterr().out)
        assert record["suite"] == "synthetic" and len(record["summaries"]) == 7
    assert count(tmp_path / "b") == 18
    assert (tmp_path / "b" / "results.parquet").is_file() and not (tmp_path / "b" / "results.json").exists()


@pytest.mark.parametrize(
    ("change", "printed"),
    [
        (["--policies", "antway,nobody"], "policy = 'nobody': must be one of"),
        (["--policies", "sipp/horizon"], "NAME or MODULE:CLASS"),
        (["--policies", "sipp/colour=red"], "the options of policy sipp are"),
        (["--policies", "no.such.module:Thing"], "can be imported"),
        (["--engine", "steam"], "local, ray"),
        (["--robot", ""], "robot = ''"),
        (["--episodes", "0"], "episodes = 0"),
        (["--workers", "-1"], "workers = -1"),
        (["--export", "csv,xls"], "export = 'xls': must be one of csv, json, parquet"),
    ],
)
def test_wrong_input_is_refused(tmp_path, monkeypatch, capsys, change, printed):
    """Wrong options exit with status 2 and one line that names field, value and what is allowed; nothing is written."""
    status, shown = run_bench(monkeypatch, *words(tmp_path / "x", *change)), capsys.readouterr()
    assert status == 2 and printed in shown.err and not shown.out and not (tmp_path / "x" / "results.csv").exists()


def test_policies_of_others_repeat_themselves(tmp_path):
    """A policy that draws from global random state does the same whatever its process played before."""
    two = [Job(one, "test_bench:Draws") for one in episodes("synthetic", 1)[:2]]
    for number, jobs in enumerate((two, two[::-1])):
        with Results(tmp_path / f"{number}.db") as results:
            bench(jobs, results)
    assert same(tmp_path / "0.db") == same(tmp_path / "1.db")


def test_what_policies_print_is_not_in_the_answer_and_a_warning_is_given_once(tmp_path):
    """It goes to stderr, also under antway run; workers do not repeat a warning with a line of the library's source."""
    rows = [f"{1000 * second},{person},{second + person},{person}" for second in range(12) for person in range(4)]
    (tmp_path / "milliseconds.csv").write_text("\n".join(rows))
    place = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    bench_line = words("b", "--policies", "test_bench:Prints", "--workers", "1", suite="tracks:milliseconds.csv")
    for line in (["run", "paper", "--policy", "test_bench:Prints"], ["bench", *bench_line]):
        line = [sys.executable, "-m", "antway", *line, "--json"]
        printed = subprocess.run(line, capture_output=True, text=True, cwd=tmp_path, env=place)
        assert json.loads(printed.stdout) and "I begin" in printed.stderr
    assert printed.stderr.count("are times in s") == 1 and "milliseconds.csv: who walks does so at" in printed.stderr
    assert "UserWarning" not in printed.stderr


def test_the_optimum_is_known_where_one_policy_hung():
    """The row of a policy that was given up does not know it; those of others do, in whatever order policies are named."""
    hung = Row("s", "e", "hung", 1, "0", "g", "timeout", "")
    mine = Row("s", "e", "mine", 1, "0", "g", "reached", "", time=12.0, bound=10.0)
    for names in (["hung", "mine"], ["mine", "hung"]):
        assert paired([hung, mine], names)[1]["mine"] == [1.2]


def test_a_file_of_others_is_refused(tmp_path, monkeypatch, capsys):
    """A results file that is none is refused with status 2 and left as it was."""
    (tmp_path / "results.db").write_text("mine " * 1000)
    assert run_bench(monkeypatch, *words(tmp_path)) == 2 and "results" in capsys.readouterr().err
    assert (tmp_path / "results.db").read_text() == "mine " * 1000


def test_policies_by_name_module_and_option():
    """A policy is found by name or as MODULE:CLASS, with options in their own types."""
    assert type(make_policy("test_bench:Raises")) is Raises
    assert make_policy("sipp/margin=0.1/predictions=mirrored").margin == 0.1
    for text in ("{[]: 1}", "-" * 20_000 + "1", "(", "mirrored"):  # no literals, and so texts
        options: dict = {}
        assert take_options(f"sipp/margin={text}", options) == "sipp" and options == {"margin": text}
    for spec in ("", "nobody", "sipp/", "test_bench:Nothing", "os:getcwd"):
        with pytest.raises(BadParameter, match="policy"):
            make_policy(spec)


def test_ray_gives_the_same_rows(tmp_path):
    """The Ray engine, on a cluster started here, gives the rows of the local engine."""
    pytest.importorskip("ray")
    script = tmp_path / "one.py"
    script.write_text(
        "import sys\n"
        "from antway.arena.engines import bench, table_jobs\n"
        "from antway.arena.store import Results\n"
        "from antway.arena.suites import episodes\n"
        "if __name__ == '__main__':\n"
        "    with Results(sys.argv[1]) as results:\n"
        "        jobs = table_jobs(episodes('synthetic', 1)[:3], ['follow'])\n"
        "        bench(jobs, results, engine='ray', workers=2, timeout=500.0)\n"
    )
    subprocess.run([sys.executable, str(script), str(tmp_path / "ray.db")], check=True, capture_output=True)
    with Results(tmp_path / "local.db") as results:
        bench(table_jobs(episodes("synthetic", 1)[:3], ["follow"]), results)
    assert same(tmp_path / "ray.db") == same(tmp_path / "local.db")


def test_a_policy_that_never_arrives_has_no_nan_in_its_table(tmp_path, monkeypatch, capsys):
    """Where nothing was reached the table says so by dashes."""
    run_bench(monkeypatch, *words(tmp_path, "--policies", "test_bench:Raises", suite="barn"))
    shown = capsys.readouterr().out
    assert "test_bench:" in shown and "nan" not in shown


def test_a_second_run_adds_to_all_files(tmp_path, monkeypatch):
    """Tables keep the rows of earlier runs in the same folder, as the report does; the summary has a section for each suite."""

    def played(jobs, results, **_):
        for job in jobs:
            results.add(Row(*job.key, job.episode.group, "reached", "", time=1.0))

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("antway.arena.engines.bench", played)
    monkeypatch.setattr("antway.view.report.write_report", lambda *_: None)
    for more in ("paper", "paper --robot diff", "synthetic"):
        run_bench(monkeypatch, *more.split(), "--episodes", "1", "--policies", "follow")
    headings = [line for line in (tmp_path / "bench" / "summary.md").read_text().splitlines() if line.startswith("## ")]
    assert headings == ["## paper", "## paper on diff", "## synthetic"]
    rows = json.loads((tmp_path / "bench" / "results.json").read_text())
    assert len(rows) == count(tmp_path / "bench") and {f"## {row['suite']}" for row in rows} == set(headings)


def test_a_policy_that_has_changed_is_played_again(tmp_path, monkeypatch, capsys):
    """Its name in rows ends with a hash of its file; a policy that always fails gives status 1 and a line that says why."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    lines = ["from antway.baselines.replan import Follow", "class Mine(Follow):", "    def act(self, o):", "        "]
    for action, status in (("raise ValueError('broken')", 1), ("return super().act(o)", 0)):
        (tmp_path / "changing.py").write_text("\n".join(lines) + action + "\n")
        assert run_bench(monkeypatch, *words("bench", "--policies", "changing:Mine", "--workers", "1", suite="barn")) == status
        assert ("failed in 2 of 2 episodes; first: " in capsys.readouterr().err) == bool(status)
    with Results(tmp_path / "bench" / "results.db") as results:
        rows = results.rows()
    failed = {row.policy for row in rows if row.outcome == "error"}
    assert len(rows) == 4 and [row.policy in failed for row in rows].count(True) == 2
    assert len(failed) == 1 and len({row.policy for row in rows} - failed) == 1


def test_versions_are_counted_on_their_own():
    """The same episode played by two versions of antway is not two episodes."""
    row = Row("synthetic", "open/low/0000", "stop", 1, "0.1.0", "open/low", "reached", "", time=1.0, bound=1.0)
    assert list(sections([row])) == ["synthetic"]
    assert list(sections([row, replace(row, version="0.2.0")])) == ["synthetic, antway 0.1.0", "synthetic, antway 0.2.0"]


def test_a_name_with_a_bar_stays_in_its_cell_in_markdown():
    """A policy's option may be any text."""
    rows = [Row("s", "e", "mine:Policy/kind=a|b", 0, "0", "g", "error", "what | went wrong")]
    lines = [line for line in markdown(rows).splitlines() if line]
    assert "mine:Policy/kind=a\\|b" in lines[2] and "a|b" not in "".join(lines)
    assert {line.count("|") - line.count("\\|") for line in lines[:3]} == {lines[0].count("|")}


def test_no_interval_of_a_ratio_is_below_nought():
    """Student's t of two episodes is wider than any time can be short."""
    rows = [Row("s", f"e{k}", "p", k, "0", "g", "reached", "", time=12.0 + 6.0 * k, bound=10.0) for k in range(2)]
    (one,) = summarise(rows)
    assert one.time_ratio_interval == (0.0, pytest.approx(1.5 + 0.3 * 12.7062, rel=1e-5))


def test_a_goal_within_the_tolerance_of_the_start_spoils_no_interval():
    """The time over its optimum, 0 / 0, counts neither for the mean nor for its interval."""
    rows = [Row("s", f"e{k}", "p", k, "0", "g", "reached", "", time=0.6 * k, bound=0.5 * k) for k in range(3)]
    (one,) = summarise(rows)
    assert one.time_ratio == 1.2 and one.time_ratio_interval == (1.2, 1.2)
    quick = replace(rows[1], time=0.06, bound=0.05)  # an optimum of less than a usual control period counts
    assert summarise([quick])[0].time_ratio == pytest.approx(1.2)


def test_a_goal_to_which_no_shortest_path_leads_spoils_no_mean():
    """A body may fit where its disc does not; the length over an infinite path, 0, counted."""
    rows = [
        Row("s", f"e{k}", "p", k, "0", "g", "reached", "", length=11.0, shortest=far) for k, far in enumerate([10.0, math.inf])
    ]
    assert summarise(rows)[0].path_ratio == 1.1


def test_few_times_have_no_rank():
    """A policy that reached the goal nine times is significantly slower than nobody, and is not first for that."""
    often, seldom, ten = np.linspace(1.0, 1.1, 30), np.where(np.arange(30) < 9, 1.5, math.nan), np.arange(30) < 10
    times = {"often": often, "seldom": seldom, "slow": 1.1 * often, "ten": np.where(ten, 1.2 * often, math.nan)}
    wins = {name: np.isfinite(mine).astype(float) for name, mine in times.items()}
    places = {name: place for name, _, _, place, _ in ranked(wins, times)}
    assert places == {"often": "1", "slow": "2", "ten": "3", "seldom": "–"}


def test_ctrl_c_while_workers_start_counts():
    """It was ignored for as long as the first of them took to start."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # tests in the background may have it ignored
    try:
        with pytest.raises(KeyboardInterrupt), uninterrupted():
            os.kill(os.getpid(), signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_process_that_dies_after_its_answer_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bench used to end with a BrokenPipeError where the next job was handed to it at that moment."""
    give = _Worker.give

    def late(worker: _Worker, job: Job) -> None:
        if worker.deadline < math.inf:  # it has answered before
            worker.process.kill()
            worker.process.join()
        give(worker, job)

    monkeypatch.setattr(_Worker, "give", late)
    jobs = table_jobs(episodes("synthetic", 1)[:3], ["follow"])
    rows = [row for row, _ in local(iter(jobs), 1, 60.0)]
    assert [row.key for row in rows] == [job.key for job in jobs] and all(row.outcome != "error" for row in rows)


def dies(pipe: object) -> None:
    """Work as a process that ends before it is ready."""
    os._exit(3)


def test_a_process_that_dies_before_it_is_ready_costs_its_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bench used to end with an EOFError."""
    monkeypatch.setattr(engines, "_work", dies)
    jobs = table_jobs(episodes("synthetic", 1)[:2], ["follow"])
    rows = [row for row, _ in local(iter(jobs), 1, 60.0)]
    assert [row.key for row in rows] == [job.key for job in jobs]
    assert all((row.outcome, row.reason) == ("error", "the process died with exit status 3") for row in rows)


def test_no_more_processes_than_workers_play_and_none_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each plays on while there are jobs, and one that reports a compiled kernel is heard again."""
    begun, stopped = [], []

    class Worker:
        def __init__(self, job: int, timeout: float) -> None:
            (self.pipe, self.far), self.process = multiprocessing.Pipe(), SimpleNamespace(is_alive=lambda: True)
            begun.append(self)
            self.give(job)

        def give(self, job: int) -> None:
            self.job, self.deadline = job, time.monotonic() + 60.0
            for answer in (None, (job, "")):
                self.far.send(answer)

        def collect(self) -> object:
            return self.pipe.recv()

        def stop(self) -> None:
            stopped.append(self)

    monkeypatch.setattr(engines, "_Worker", Worker)
    for workers in (1, 3, 20):
        begun.clear()
        stopped.clear()
        assert sorted(job for job, _ in local(iter(range(10)), workers, 60.0)) == list(range(10))  # type: ignore[arg-type]
        assert len(begun) == min(workers, 10) and set(stopped) == set(begun)


def test_compiling_does_not_count_as_the_time_of_a_policy() -> None:
    """Each report of a compiled kernel starts the time limit again."""
    worker, (ours, theirs) = _Worker.__new__(_Worker), multiprocessing.Pipe()
    worker.pipe, worker.timeout = ours, 60.0  # type: ignore[assignment]
    worker.give(Job(episodes("synthetic", 1)[0], "follow"))
    worker.deadline -= 50.0
    theirs.send(None)
    assert worker.collect() is None and 59.0 < worker.deadline - time.monotonic() <= 60.0


def test_a_time_limit_may_be_of_any_length() -> None:
    """The bench used to end with an OverflowError from 25 days on."""
    jobs = table_jobs(episodes("synthetic", 1)[:1], ["follow"])
    ((row, _),) = local(iter(jobs), 1, 1e300)
    assert row.key == jobs[0].key and row.outcome != "error"


def test_an_answer_that_came_while_others_were_written_counts() -> None:
    """Rows may be written slowly, for instance while another run has locked the file."""
    (one,) = episodes("synthetic", 1)[:1]
    given_up = []
    for row, _ in local(iter([Job(one, "follow"), Job(one, "test_bench:Tarries")]), 2, 6.0):
        given_up.append("given up" in row.reason)
        time.sleep(6.5 if len(given_up) == 1 else 0.0)
    assert given_up == [False, False]


def test_a_thread_that_compiles_does_not_spoil_an_answer() -> None:
    """Answers arrive whole, although another thread reports kernels meanwhile; long ones are written in several parts."""
    ours, theirs = multiprocessing.Pipe()
    line, answer, over = engines._Line(theirs), "x" * 100_000, threading.Event()
    compiled = engines._Compiled(line)

    def report() -> None:
        while not over.is_set():
            compiled.on_end(None)

    def play() -> None:
        for _ in range(50):
            line.send(answer)
        over.set()

    threads = [threading.Thread(target=work, daemon=True) for work in (report, play)]
    for thread in threads:
        thread.start()
    whole = 0
    while whole < 50:
        assert ours.poll(10.0)
        received = ours.recv()
        assert received in (None, answer)
        whole += received is not None
    while ours.poll(0.1):
        assert ours.recv() is None
    for thread in threads:
        thread.join(10.0)
