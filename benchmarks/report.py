"""What the benchmark programs share: where the data is, how tables are printed, and where results are written."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"  # public instances, maps and recordings; its SOURCES.md says where they come from
OUT = ROOT / "benchmarks" / "out"


def cells(row: Mapping[str, object], floats: str = "") -> list[str]:
    """Return the values of a row as texts, floats in the format `floats`."""
    return [f"{value:{floats}}" if isinstance(value, float) else str(value) for value in row.values()]


def markdown(row: Mapping[str, object], floats: str) -> str:
    """Return a row as a line of a table in Markdown."""
    return f"| {' | '.join(cells(row, floats))} |"


def show(rows: Sequence[Mapping[str, object]], title: str | None = None, *, floats: str = "", width: int | None = None) -> None:
    """Print rows with the same keys as a table, `width` characters wide (None: as wide as the terminal)."""
    table = Table(*rows[0], title=title)
    for row in rows:
        table.add_row(*cells(row, floats))
    Console(width=width).print(table)


def write(file: str | Path, results: object) -> None:
    """Write results as JSON to a file, or to one of that name in benchmarks/out."""
    path = OUT / file if isinstance(file, str) else file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def written(file: str | Path) -> dict[str, Any]:
    """Return what an earlier run wrote to that file; nothing if there is none."""
    path = OUT / file if isinstance(file, str) else file
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
