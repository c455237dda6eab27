"""Hypothesis runs derandomised, so that a red test is red for everybody; `make nightly` explores."""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, settings

from common import SCALE

settings.register_profile("tests", derandomize=SCALE == 1, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("tests")

# Files that take longest, mostly because they wait for processes. One of them that began last would run alone for minutes.
FIRST = ("test_ros_node", "test_bench", "test_guard_dynamics", "test_page", "test_surroundings", "test_rollout", "test_demo")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files that take longest first."""
    items.sort(key=lambda item: FIRST.index(item.path.stem) if item.path.stem in FIRST else len(FIRST))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let whatever runs beside the real ROS 2 node give way to it: its robots are driven in real time."""
    if item.path.stem != FIRST[0] and os.nice(0) == 0:
        os.nice(5)
