"""The scenes that come with the package: a 20 x 20 grid as in the paper, an office, a warehouse aisle; rounds in a ward."""

from __future__ import annotations

from pathlib import Path

from antway import checks

SCENES = ("paper", "office", "warehouse")
ROUNDS = ("rounds",)  # scenes with stops


def scene(name: str) -> Path:
    """Return the scenario file of the shipped scene of that name.

    Examples
    --------
    >>> scene("office").name
    'office.toml'
    """
    return Path(__file__).parent / f"{checks.choice('scene', name, (*SCENES, *ROUNDS))}.toml"
