"""The state of a tab of a page, which takes requests and returns scenes and frames, independent of sockets."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from typing import Any, ClassVar

from antway import checks
from antway.errors import BadParameter
from antway.web.view import Message
from antway.web.workers import SECONDS, WORK, Workers


class Tab(ABC):
    """A run that can be played, stepped and paused.

    A method do_X carries out the requests of the page with `op` X: it takes a message and returns the messages to send back,
    or nothing.
    """

    SPEEDS: ClassVar[tuple[float, ...]]  # allowed speeds of play

    def __init__(self, speed: float) -> None:
        self.closed = threading.Event()  # set when the tab is closed, so that long work ends
        self.workers: Workers | None = None  # which read files and make exports; None: this process does it
        self.playing, self.speed = False, speed

    @property
    @abstractmethod
    def period(self) -> float:
        """Seconds of the clock that one step takes."""

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether there is nothing left to play."""

    @property
    def is_behind(self) -> bool:
        """Whether the page lacks something that the last frame had no space for."""
        return False

    @abstractmethod
    def advance(self) -> None:
        """Play a step, unless the tab is closed or the run has ended; a run that ends sets `playing` to False."""

    @abstractmethod
    def frame(self) -> Message:
        """Return the content of the page at this moment, at most 60 kB as JSON."""

    @abstractmethod
    def describe(self) -> Message:
        """Return everything that does not change while the run plays."""

    def work(self, name: str, *given: object, seconds: float = SECONDS) -> Any:
        """Return the result of a task, done in a separate process if there are any."""
        if self.workers is None:
            return WORK[name](*given)
        return self.workers.run(name, *given, seconds=seconds, closed=self.closed)

    def apply(self, message: object) -> list[Message]:
        """Carry out the request in `message` and return the messages to send; a frame follows in any case.

        Invalid messages raise a `BadInput` and change nothing.
        """
        if not isinstance(message, dict):
            raise BadParameter("message", message, "a JSON object")
        do = getattr(self, f"do_{message.get('op')}", None)
        if do is None:
            allowed = ", ".join(name.removeprefix("do_") for name in dir(self) if name.startswith("do_"))
            raise BadParameter("op", message.get("op"), f"one of {allowed}")
        replies: list[Message] | None = do(message)
        return replies or []

    def do_play(self, message: Message) -> None:
        self.playing = checks.instance("on", message.get("on"), bool) and not self.ended

    def do_step(self, message: Message) -> None:
        self.playing = False
        self.advance()

    def do_speed(self, message: Message) -> None:
        speed = checks.number("speed", message.get("speed"))
        if speed not in self.SPEEDS:
            raise BadParameter("speed", speed, f"one of {', '.join(f'{s:g}' for s in self.SPEEDS)}")
        self.speed = speed
