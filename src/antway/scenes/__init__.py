"""The scenes that come with the package: a 20 x 20 grid as in the paper, an office, a warehouse aisle; rounds in a ward."""

from __future__ import annotations

from pathlib import Path

from antway import checks
from antway.tables import SHIPPED_SCENES

SCENES, ROUNDS = SHIPPED_SCENES[:3], SHIPPED_SCENES[3:]  # the last ones have stops


def scene(name: str) -> Path:
    """Return the scenario file of the shipped scene of that name.

    Examples
    --------
    >>> scene("office").name
    'office.toml'
    """
    return Path(__file__).parent / f"{checks.choice('scene', name, SHIPPED_SCENES)}.toml"


def shipped(name: object, *, map_file: bool = False) -> Path | None:
    """Return the scenario, or the map, of the scene called `name`; None if it is none or a file of that name is there.

    Examples
    --------
    >>> shipped("office", map_file=True).name
    'office.yaml'
    """
    if not isinstance(name, str | Path) or str(name) not in SHIPPED_SCENES or Path(name).is_file():
        return None
    file = scene(str(name))
    return file.with_suffix(".yaml") if map_file else file
