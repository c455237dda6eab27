"""The guard in a process of its own: what it adds to a planner's cycle, how soon it answers, and drives whose planner ends.

Run as `python benchmarks/guard_process.py [--drives N] [--cycles N]`. In each drive a planner is killed or stopped a
random time after a random observation; the drive counts as held if every later answer brakes, the robot comes to a stand, and
nothing touches it while it moves. Drives with an answer later than one control period are counted apart.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from antway import Outcome
from antway.policies.guard_memory import Link
from antway.policies.guard_process import GuardProcess
from antway.world.policy import make_policy
from antway.world.stage import Stage
from guard_drives import PERIOD, ROBOTS, drives, place


def added(cycles: int) -> None:
    """Print by how much a planner's cycle is longer when it takes observations from, and gives commands to, the guard."""
    scenario = place(7, ROBOTS["holonomic"])
    policy, stage = make_policy("antway", mode="strict"), Stage(scenario, 0, scenario.horizon)
    policy.reset(scenario.task, 0)
    alone, extra, answers, own = [], [], [], []
    with GuardProcess(scenario.task, mode="strict") as guard:
        link = Link(guard.folder, "planner")
        for _ in range(cycles):
            seen = stage.observe()
            number = guard.observe(seen)
            cpu, started = time.thread_time(), time.perf_counter()
            found = link.observed(number - 1)
            assert found is not None
            read, cpu_read = time.perf_counter(), time.thread_time()
            command = policy.act(found[1])
            cpu_planned, planned = time.thread_time(), time.perf_counter()
            link.ask(number, command)
            asked, cpu_asked = time.perf_counter(), time.thread_time()
            own.append(cpu_read - cpu + cpu_asked - cpu_planned)
            answer = guard.answer(number)
            answers.append(time.perf_counter() - asked)
            alone.append(planned - read)
            extra.append(read - started + asked - planned)
            if stage.drive(*stage.controls(answer.command, seen))[0]:  # it is at the goal
                policy.reset(scenario.task, 0)
                guard.reset(scenario.task)
                stage = Stage(scenario, 0, scenario.horizon)
        link.close()
    lines = {
        "a cycle of the policy alone": alone,
        "added to it": extra,
        "of that, processor time of its own": own,
        "from command to answer": answers,
    }
    for what, times in lines.items():
        low, high = np.percentile(np.array(times[10:]) * 1e6, (50, 99))
        print(f"{what}: median {low:.1f} us, 99th percentile {high:.0f} us, {len(times) - 10} cycles")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--cycles", type=int, default=2000)
    given = parser.parse_args()
    added(given.cycles)
    if given.drives == 0:
        return
    held, late, ended, took = 0, 0, 0, []
    for drive in drives(given.drives, seed=1000):
        ended += bool(drive.after)
        took += drive.after
        clear = drive.outcome in (None, Outcome.REACHED, Outcome.HIT_STANDING)
        braked = set(drive.did) <= {"braked"} and (drive.outcome is not None or drive.speed < 1e-6)
        late += any(t > PERIOD for t in drive.after)
        held += clear and braked
    worst = max(took, default=0.0)
    print(
        f"{held} of {given.drives} drives held, {ended} of them with answers after the planner's end; "
        f"{late} with an answer later than one period of {PERIOD:g} s; slowest answer {worst:.3f} s"
    )


if __name__ == "__main__":
    main()
