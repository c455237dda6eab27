"""Passes a tab's requests to its session and frames back, with limits of size and rate, without waiting for slow pages."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import TypeVar

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from antway.errors import BadInput, BadParameter
from antway.reading import count_lists
from antway.web.tab import Tab
from antway.web.view import Message

T = TypeVar("T")

MAX_SMALL = 2**19  # limit of bytes of a message, unless it opens a file
MAX_LISTS = 50_000  # limit of lists and objects in a message; in memory an empty one takes twenty times its text
RATE = 60.0  # 1/s; limit of messages from a page
BURST = 240.0  # limit of messages from a page at once
IN_FLIGHT = 2  # limit of unconfirmed frames
TIMEOUT = 7.0  # s; how long a frame may be unconfirmed; then the page is disconnected within 10 s, even by a busy server
TICK = 1 / 40  # s; least time between frames
THREADS = 2  # number of threads that play; more would delay the event loop, which shares the interpreter
SLICE = 0.05  # s; how long a tab may play before others have their turn
LULL = 0.01  # s; time without a request after which play continues
HOLD = 1.0  # s; longest delay of play by requests


class Turns:
    """Shares a few threads among the tabs, first come, first served; requests have priority over play.

    A user waits for the answer to a request, which takes a fraction of a millisecond, whereas a late control cycle is simply
    left out.
    """

    def __init__(self, threads: int = THREADS) -> None:
        self.workers = ThreadPoolExecutor(threads, "antway")
        self.latest_request = -math.inf  # time on the clock of the event loop
        self.playing = asyncio.Semaphore(threads)  # at most this many tabs play or wait for a lull at a time

    def request(self) -> None:
        """Record that a file is requested or a tab opened."""
        self.latest_request = asyncio.get_running_loop().time()

    async def take(self, work: Callable[..., T], *given: object) -> T:
        """Run `work` in one of the threads, so that the server can answer others meanwhile."""
        return await asyncio.get_running_loop().run_in_executor(self.workers, work, *given)

    @asynccontextmanager
    async def lull(self) -> AsyncIterator[None]:
        """Wait until there was no request for a moment (at most `HOLD` s), and until few others play."""
        time = asyncio.get_running_loop().time
        latest = time() + HOLD
        async with self.playing:
            while time() < self.latest_request + LULL:
                await asyncio.sleep(LULL)  # always once, so that not all tabs that waited continue at the same time
                if time() >= latest:
                    break
            yield


class Player:
    """Passes requests to a session and frames back, at the pace of the clock and never ahead of the page."""

    def __init__(self, websocket: WebSocket, session: Tab, turns: Turns, exports: Turns) -> None:
        self.websocket, self.session = websocket, session
        self.turns, self.exports = turns, exports  # files and exports may take seconds and must not delay the play of others
        self.turn, self.wake = asyncio.Lock(), asyncio.Event()
        self.owed, self.in_flight = True, 0
        self.answering, self.heard = False, 0.0
        self.clock = asyncio.get_running_loop().time

    async def run(self) -> None:
        """Serve until the page is closed, sends too much, or stops confirming frames."""
        tasks = [asyncio.create_task(task) for task in (self.play(), self.listen(), self.watch())]
        try:
            await self.send(await self.turns.take(lambda: _text(self.session.describe())))
            await self.show()
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except WebSocketDisconnect:
            pass
        finally:
            self.session.closed.set()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def listen(self) -> None:
        """Answer the page's requests until it is closed or sends too many."""
        allowance, last = BURST, self.clock()
        while True:
            message = await self.websocket.receive()
            if message["type"] == "websocket.disconnect":
                return None
            now = self.clock()
            allowance, last = min(BURST, allowance + (now - last) * RATE) - 1.0, now
            text = message.get("text")
            if text is None or allowance < 0.0:
                return await self.hang_up()
            self.answering = True
            await self.answer(text)
            self.answering, after = False, self.clock()
            # A confirmation may have come while the request was answered, and has then not been read yet.
            self.heard = max(self.heard, after - TIMEOUT + min(after - now, 1.0))

    async def watch(self) -> None:
        """Return once the page has left a frame unconfirmed for too long."""
        while self.answering or not self.in_flight or self.clock() - self.heard < TIMEOUT:
            await asyncio.sleep(TIMEOUT / 32)
        await self.hang_up()

    async def answer(self, text: str) -> None:
        """Carry out one request and send the answer."""
        async with self.turn:
            request: object = None
            try:
                request = _parse(text)
                if request == {"op": "seen"}:
                    self.in_flight, self.heard = max(0, self.in_flight - 1), self.clock()
                    replies: list[Message] = []
                else:
                    slow = isinstance(request, dict) and request.get("op") in ("export", "open")
                    turns = self.exports if slow else self.turns
                    replies = await turns.take(self.session.apply, request)
                    self.owed = True
                    self.wake.set()
            except BadInput as error:
                replies = [_refusal(error, request)]
            for reply in replies:
                await self.send(_text(reply))
        await self.show()

    async def play(self) -> None:
        """Advance the session at the pace of the clock; late cycles are left out, not made up for."""
        due = self.clock()
        while True:
            if not self.session.playing:
                self.wake.clear()
                await self.wake.wait()
                due = self.clock()
                continue
            period = self.session.period
            steps = max(1, round(TICK / period))
            due = max(due + steps * period, self.clock())
            if await self.changed(due, period):
                due = self.clock()
            else:
                await self.show(steps)

    async def changed(self, due: float, period: float) -> bool:
        """Wait until `due`; return earlier, and True, if a request pauses play or changes its pace."""
        while (left := due - self.clock()) > 0.0:
            self.wake.clear()
            with suppress(TimeoutError):
                await asyncio.wait_for(self.wake.wait(), left)
                if not self.session.playing or self.session.period != period:
                    return True
        return False

    async def show(self, steps: int = 0) -> None:
        """Play this many steps, and send a frame if the page has confirmed the earlier ones; otherwise skip it."""
        async with AsyncExitStack() as lull:
            if steps:
                await lull.enter_async_context(self.turns.lull())  # before the turn is taken, so that requests are not delayed
                if self.turn.locked():
                    return  # a request is being answered, which may take long: these steps are left out
            async with self.turn:
                steps = steps if self.session.playing else 0
                self.owed = self.owed or steps > 0
                send_frame = self.owed and self.in_flight < IN_FLIGHT
                if not (steps or send_frame):
                    return
                text = await self.turns.take(self.moment, steps, send_frame)
                await lull.aclose()  # a page that reads slowly does not delay the play of others
                if send_frame:
                    await self.send(text)
                    self.heard = self.heard if self.in_flight else self.clock()
                    self.owed, self.in_flight = self.session.is_behind, self.in_flight + 1

    def moment(self, steps: int, send_frame: bool) -> str:
        """Play this many steps; return the frame of the moment, or nothing if none is to be sent.

        Steps that do not start within `SLICE` are left out, so that others do not wait longer for their turn.
        """
        until = time.perf_counter() + SLICE
        while steps and time.perf_counter() < until:
            self.session.advance()
            steps = steps - 1 if self.session.playing else 0
        return _text(self.session.frame()) if send_frame else ""

    async def hang_up(self) -> None:
        if self.websocket.application_state is WebSocketState.CONNECTED:
            await self.websocket.close(1008)

    async def send(self, text: str) -> None:
        if self.websocket.application_state is not WebSocketState.CONNECTED:
            raise WebSocketDisconnect(1006)
        await self.websocket.send_text(text)


def _refusal(error: BadInput, request: object) -> Message:
    """Return why a request was refused, and its number if the page gave one; the wrong field may be another one."""
    number = request.get("number") if isinstance(request, dict) else None
    number = number if isinstance(number, int) else None
    return {"kind": "refused", "error": type(error).__name__, "field": error.field, "number": number, "text": str(error)}


def _text(message: Message) -> str:
    return json.dumps(message, allow_nan=False, separators=(",", ":"))


def _parse(text: str) -> object:
    lists = count_lists(text)
    if lists > MAX_LISTS:
        raise BadParameter("message", f"{lists} lists", f"at most {MAX_LISTS} lists and objects")
    try:
        request = json.loads(text)
    except (ValueError, RecursionError):
        raise BadParameter("message", text[:80], "JSON") from None
    if len(text) > MAX_SMALL and not (isinstance(request, dict) and request.get("op") == "open"):
        raise BadParameter("message", f"{len(text)} characters", f"at most {MAX_SMALL} characters")
    return request
