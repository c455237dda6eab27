"""Hypothesis runs derandomised, so that a red test is red for everybody; `make nightly` explores."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

from common import SCALE

settings.register_profile("tests", derandomize=SCALE == 1, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("tests")
