"""Hypothesis runs derandomised, so that a red test is red for everybody; `make nightly` explores.

Files that take long run first, so that no process waits at the end for one of them. The tests of the ROS 2 node are among them,
but not the very first: they time answers, and `make check` runs beside the first tests.
"""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, settings

from common import SCALE

settings.register_profile("tests", derandomize=SCALE == 1, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("tests")

SLOW = "bench", "response", "guard_dynamics", "surroundings", "ros_node", "absurd", "episode", "rollout", "demo", "page", "load"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests of slow files first."""
    places = {f"test_{name}": place for place, name in enumerate(SLOW)}
    items.sort(key=lambda item: places.get(item.path.stem, len(SLOW)))
