"""Memory shared by guard process, planner and robot side: observations, requested commands, answers, bells.

Each record has its number at both ends. The writer clears both, writes the content and puts the number back, at the end first;
so a reader that finds the same number at both ends has a complete record, unless the writer uses the same number again, as the
guard does while it brakes: `Link.replied` therefore reads twice. The content is checked by the writer and not again by
the reader, because this takes time in every cycle of the planner.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import select
import struct
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from antway.errors import TooLarge
from antway.policies.guard import DID, check_shapes
from antway.world.policy import Command, Observation, Tracks

MAX_TRACKS = 1024  # limit of tracks in an observation
_PENDING = 128  # limit of commands that do not act yet
_OBSERVATION = 13  # numbers of an observation without its tracks
SIDES = ("robot", "planner", "guard")
_LAYOUT = np.dtype(
    [
        ("observation", "<f8", _OBSERVATION),
        ("tracks", "<f8", 6 * MAX_TRACKS),  # numbers, places, velocities and radii of n tracks, one after the other: `_arrays`
        ("covariance", "<f8", (MAX_TRACKS, 4, 4)),
        ("pending", "<f8", (_PENDING, 2)),
        ("asked", "<f8", 7),
        ("answer", "<f8", 9),
        ("rest", "<f8", (1,)),
    ]
)
_FIELDS: Any = _LAYOUT.fields
SIZE, _TRACKS = _LAYOUT.itemsize, _FIELDS["tracks"][1]  # bytes
_READ = struct.Struct(f"<{_OBSERVATION}d").unpack_from
_WHOLE, _REAL = np.dtype(np.int64), np.dtype(np.float64)


@dataclass(frozen=True, slots=True)
class GuardAnswer:
    """The answer to an observation."""

    number: int  # of the observation that it answers
    command: Command
    did: str  # what the guard did (`guard.DID`); "silent": the guard process gave no answer, and the robot brakes


def _arrays(n: int, memory: Any, at: int = 0) -> tuple[Any, Any, Any, Any]:
    """Return numbers, places, velocities and radii of n tracks in `memory` from byte `at` on."""
    make, pairs = np.ndarray, (n, 2)
    return (
        make(n, _WHOLE, memory, at),
        make(pairs, _REAL, memory, at + 8 * n),
        make(pairs, _REAL, memory, at + 24 * n),
        make(n, _REAL, memory, at + 40 * n),
    )


# Setters of the fields; a loop over them, or the checks of the classes, would take twice the time.
_put_id, _put_xy, _put_velocity, _put_radius, _put_covariance = (getattr(Tracks, name).__set__ for name in Tracks.__slots__)
_put_t, _put_place, _put_speed, _put_heading, _put_tracks, _put_stamp, _put_turn_rate, _put_pending = (
    getattr(Observation, name).__set__ for name in Observation.__slots__
)


class Link:
    """One side's access to the shared memory. Numbers at both ends of a record prevent partial reads."""

    def __init__(self, folder: str, side: str) -> None:
        self.folder, self.side = folder, side
        with open(Path(folder) / "memory", "r+b") as file:
            self.memory = mmap.mmap(file.fileno(), SIZE)
        whole = np.ndarray((), _LAYOUT, self.memory)
        self.views: dict[str, Any] = {name: whole[name] for name in _FIELDS}
        # A named pipe for each side, opened at both ends, so that a writer does not need a reader.
        self.bells = {other: os.open(f"{folder}/{other}", os.O_RDWR | os.O_NONBLOCK) for other in SIDES}
        self.bell = self.bells[side]
        self.poll = select.poll()
        self.poll.register(self.bell, select.POLLIN)

    def close(self) -> None:
        """Release the memory."""
        while self.bells:
            os.close(self.bells.popitem()[1])
        self.views.clear()
        with contextlib.suppress(BufferError):
            self.memory.close()

    def ring(self, *sides: str) -> None:
        """Wake other sides that wait. The pipe of a side that never listens may become full, which does not matter."""
        for side in sides:
            try:  # noqa: SIM105 - takes half the time
                os.write(self.bells[side], b".")
            except BlockingIOError:
                pass

    def wait(self, until: float) -> bool:
        """Return when the bell rings, or at `until` s of the steady clock; True if another polled file has data."""
        ready = self.poll.poll(max((until - time.monotonic()) * 1e3, 0.0))
        if ready:
            with contextlib.suppress(BlockingIOError):
                os.read(self.bell, select.PIPE_BUF)
        return any(number != self.bell for number, _ in ready)

    def _cleared(self, name: str) -> Any:
        view = self.views[name]
        view[-1] = -1.0
        view[0] = -1.0
        return view

    def observe(self, number: int, o: Observation) -> None:
        """Write an observation."""
        t, n = o.tracks, len(o.tracks)
        pending = 0 if o.pending is None else len(o.pending)
        if n > MAX_TRACKS or pending > _PENDING:
            raise TooLarge("tracks, pending", (n, pending), f"at most {MAX_TRACKS} and {_PENDING}")
        check_shapes(o)
        view, views = self._cleared("observation"), self.views
        names, xy, velocity, radius = _arrays(n, self.memory, _TRACKS)
        names[:], xy[:], velocity[:], radius[:] = t.id, t.xy, t.velocity, t.radius
        if t.covariance is not None:
            views["covariance"][:n] = t.covariance
        if o.pending is not None:
            views["pending"][:pending] = o.pending
        noisy = float(t.covariance is not None)
        waiting = -1 if o.pending is None else pending
        view[1:-1] = o.t, *o.xy, *o.velocity, o.heading, o.stamp, o.turn_rate, n, waiting, noisy
        view[-1] = view[0] = number

    def observed(self, after: int) -> tuple[int, Observation] | None:
        """Return the last observation and its number, if it is newer than `after` and not being written."""
        memory, views, make = self.memory, self.views, object.__new__
        number, t, x, y, vx, vy, heading, stamp, turn_rate, n, m, noisy, last = _READ(memory)
        if number <= after or number != last or not 0 <= n <= MAX_TRACKS:
            return None
        n, m = int(n), int(m)
        names, xy, velocity, radius = _arrays(n, bytearray(memory[_TRACKS : _TRACKS + 48 * n]))
        tracks, observation = make(Tracks), make(Observation)
        _put_id(tracks, names)
        _put_xy(tracks, xy)
        _put_velocity(tracks, velocity)
        _put_radius(tracks, radius)
        _put_covariance(tracks, views["covariance"][:n].copy() if noisy else None)
        _put_t(observation, t)
        _put_place(observation, (x, y))
        _put_speed(observation, (vx, vy))
        _put_heading(observation, heading)
        _put_tracks(observation, tracks)
        _put_stamp(observation, stamp)
        _put_turn_rate(observation, turn_rate)
        _put_pending(observation, views["pending"][:m].copy() if m >= 0 else None)
        return None if _READ(memory)[0] != number else (int(number), observation)

    def ask(self, number: int, command: Command | None) -> None:
        """Write the command that the planner requests in answer to that observation."""
        view = self._cleared("asked")
        view[1:-1] = _numbers(command)
        view[-1] = view[0] = number

    def asked(self, number: int) -> tuple[bool, Command | None]:
        """Return whether the planner has answered that observation, and the requested command."""
        first, *numbers, last = self.views["asked"].tolist()
        if not first == last == number:
            return False, None
        return True, _command(*numbers) if numbers[0] else None

    def reply(self, number: int, command: Command, did: str) -> None:
        """Write the guard's answer."""
        view = self._cleared("answer")
        view[1:-1] = *_numbers(command), DID.index(did), time.monotonic()
        view[-1] = view[0] = number

    def replied(self, number: int) -> GuardAnswer | None:
        """Return the guard's answer to that observation, if there is one."""
        record = self.views["answer"].tolist()
        first, *numbers, did, _, last = record
        if not first == last == number or self.views["answer"].tolist() != record:  # the guard may be answering it again
            return None
        return GuardAnswer(number, _command(*numbers), DID[int(did)])


def _numbers(command: Command | None) -> tuple[float, ...]:
    """Return a command in numbers; the first is 0 for None, 2 for a command with a twist, else 1."""
    if command is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    vx, vy = command.velocity
    return (1.0, vx, vy, 0.0, 0.0) if command.twist is None else (2.0, vx, vy, *command.twist)


def _command(kind: float, vx: float, vy: float, v: float, omega: float) -> Command:
    """Return the command of these numbers."""
    return Command((vx, vy), (v, omega) if kind == 2.0 else None)
