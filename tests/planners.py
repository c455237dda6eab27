"""A process that makes planners: each a copy of itself that has everything loaded. It says the pid of each that it makes."""

from __future__ import annotations

import os
import pickle
import signal
import sys

from antway import make_policy
from antway.policies.guard_process import plan_for
from antway.world.stage import Stage


def main() -> None:
    """Take (folder, scenario, policy's options, seed) from stdin, time and again."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    known = set()
    while sys.stdin.buffer.peek(1):
        folder, scenario, options, seed = pickle.load(sys.stdin.buffer)
        policy = make_policy("antway", **options)
        if scenario.task.robot not in known:  # compile, and load
            known.add(scenario.task.robot)
            policy.reset(scenario.task, seed)
            stage = Stage(scenario, seed, scenario.horizon)
            for _ in range(3):
                stage.drive(*stage.controls(policy.act(stage.observe()), stage.observe()))
        pid = os.fork()
        if pid == 0:
            policy.reset(scenario.task, seed)
            plan_for(folder, policy)
            os._exit(0)
        print(pid, flush=True)


if __name__ == "__main__":
    main()
