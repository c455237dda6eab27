"""The state behind one tab of a page: requests come in, scenes and frames go out. A tab knows nothing of sockets."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

from antway import checks
from antway.errors import BadParameter
from antway.web.apart import SECONDS, WORK, Apart
from antway.web.view import Message


class Tab(ABC):
    """A run that can be played, stepped and paused.

    Attributes
    ----------
    SPEEDS : tuple of float
        What `speed` may be.
    playing : bool
    speed : float
        How fast the run plays.
    closed : threading.Event
        Set when the tab is closed, so that long work ends.
    apart : Apart or None
        Processes that read files and make exports; None: this one does.
    operations : dict of str to callable
        The requests of the page: each takes a message and returns the messages to send back.
    """

    SPEEDS: ClassVar[tuple[float, ...]]

    def __init__(self, speed: float) -> None:
        self.closed = threading.Event()
        self.apart: Apart | None = None  # where the server gives it processes for what must not hurt others
        self.playing, self.speed = False, speed
        self.operations: dict[str, Callable[[Message], list[Message]]] = {
            "play": self._play,
            "step": self._step,
            "speed": self._speed,
        }

    @property
    @abstractmethod
    def period(self) -> float:
        """Seconds of the clock that one step takes."""

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether there is nothing left to play."""

    @abstractmethod
    def advance(self, steps: int) -> None:
        """Play this many steps, or fewer if the tab is closed or the run ends; a run that ends sets `playing` to False."""

    @abstractmethod
    def frame(self) -> Message:
        """Return what the page shows of this moment: at most 60 kB as JSON."""

    @abstractmethod
    def describe(self) -> Message:
        """Return everything that does not change while the run plays."""

    def work(self, name: str, *given: object, seconds: float = SECONDS) -> Any:
        """Return what a piece of work gives, done in a process of its own if there are any."""
        if self.apart is None:
            return WORK[name](*given)
        return self.apart.run(name, *given, seconds=seconds, closed=self.closed)

    def apply(self, message: object) -> list[Message]:
        """Carry out the request in `message` and return the messages to send; a frame follows in any case.

        Raises
        ------
        BadInput
            For wrong messages, which change nothing.
        """
        if not isinstance(message, dict):
            raise BadParameter("message", message, "a JSON object")
        return self.operations[checks.choice("op", message.get("op"), self.operations)](message)

    def _play(self, message: Message) -> list[Message]:
        self.playing = checks.instance("on", message.get("on"), bool) and not self.ended
        return []

    def _step(self, message: Message) -> list[Message]:
        self.playing = False
        self.advance(1)
        return []

    def _speed(self, message: Message) -> list[Message]:
        speed = checks.number("speed", message.get("speed"))
        if speed not in self.SPEEDS:
            raise BadParameter("speed", speed, f"one of {', '.join(f'{s:g}' for s in self.SPEEDS)}")
        self.speed = speed
        return []
