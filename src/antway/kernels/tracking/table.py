"""Tables with one row for each track."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row

TRACK_ID, SEEN = range(2)  # first columns of most tables: the id of the track, and when it was last seen, s
_LOST = 1.0  # s; a track that was not seen for longer is dropped


class Table(NamedTuple):
    """What is kept of tracks from scan to scan."""

    rows: Floats  # [M, C]
    used: Ints  # [1] number of rows in use
    id_column: int  # column of the tracks' ids; that of when they were last seen follows


def make_table(rows: int, columns: int, id_column: int = TRACK_ID) -> Table:
    """Return an empty table."""
    return Table(np.zeros((rows, columns)), np.zeros(1, np.int64), id_column)


def rows_in_use(table: Table) -> Floats:
    """Return a view of the rows in use."""
    return table.rows[: table.used[0]]


@kernel
def by_id(track_id: Ints) -> Ints:
    """Return the order of a scan by the ids of its tracks: what is learnt of all of them together depends on the order."""
    for k in range(1, len(track_id)):
        if track_id[k] < track_id[k - 1]:
            return np.argsort(track_id)
    return np.arange(len(track_id))  # most sensors tell them in this order


@bare_kernel
def row_of(table: Table, track_id: float) -> int:
    """Return the row of the track with this id, or -1 if there is none."""
    for i in range(table.used[0]):
        if table.rows[i, table.id_column] == track_id:
            return i
    return -1


@bare_kernel
def row_for(table: Table, track_id: float) -> tuple[int, bool]:
    """Return the row of the track with this id, and whether it is new: zeros but for the id.

    In a full table there is none for a new track, and the row is -1.
    """
    i = row_of(table, track_id)
    if i >= 0 or table.used[0] == len(table.rows):
        return i, i < 0
    i = table.used[0]
    table.used[0] += 1
    table.rows[i] = 0.0
    table.rows[i, table.id_column] = track_id
    return i, True


@bare_kernel
def known_row(table: Table, track_id: float, seen: bool) -> tuple[int, bool]:
    """Do as `row_for`, but a track that is not `seen` gets no new row."""
    return row_for(table, track_id) if seen else (row_of(table, track_id), False)


@bare_kernel
def row_or_oldest(table: Table, track_id: float) -> tuple[int, bool]:
    """Do as `row_for`, but in a full table a new track replaces the one that was unseen for longest."""
    i, is_new = row_for(table, track_id)
    return (int(np.argmin(table.rows[:, table.id_column + 1])) if i < 0 else i), is_new


@bare_kernel
def drop_lost(table: Table, t: float) -> None:
    """Drop the tracks that were last seen more than 1 s before `t`."""
    kept = 0
    for i in range(table.used[0]):
        if t - table.rows[i, table.id_column + 1] <= _LOST:
            if kept != i:
                copy_row(table.rows[i], table.rows[kept])
            kept += 1
    table.used[0] = kept
