"""Carries a tab's wishes to its session and frames back: bounded in size and rate, never waiting for a slow page."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from antway.errors import BadInput, BadParameter
from antway.web.lane import Message
from antway.web.tab import Tab

T = TypeVar("T")

MAX_SMALL = 2**19  # bytes of a message that opens no file
RATE, BURST = 60.0, 240.0  # messages a second, and at once
IN_FLIGHT = 2  # frames that the page has not confirmed
PATIENCE = 10.0  # s that a page may take nothing before it is cut off
TICK = 1 / 40  # s between frames at the least
_WORKERS = ThreadPoolExecutor(2, "antway")  # more would leave the loop, which shares the interpreter, less of the time


class Player:
    """Carries wishes to a session and frames back, at the pace of the clock and never ahead of the page."""

    def __init__(self, websocket: WebSocket, session: Tab) -> None:
        self.websocket, self.session = websocket, session
        self.turn, self.wake = asyncio.Lock(), asyncio.Event()
        self.owed, self.in_flight = True, 0
        self.answering, self.heard = False, 0.0

    async def run(self) -> None:
        """Serve until the page is gone, asks too much, or does not take what it is sent."""
        tasks = [asyncio.create_task(task) for task in (self.play(), self.listen(), self.watch())]
        try:
            await self.send(await _aside(lambda: _text(self.session.describe())))
            await self.show()
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except (WebSocketDisconnect, TimeoutError):
            pass
        finally:
            self.session.closed.set()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def listen(self) -> None:
        """Do what the page asks until it is gone or floods."""
        clock = asyncio.get_running_loop().time
        allowance, last = BURST, clock()
        while True:
            message = await self.websocket.receive()
            if message["type"] == "websocket.disconnect":
                return None
            now = clock()
            allowance, last = min(BURST, allowance + (now - last) * RATE) - 1.0, now
            text = message.get("text")
            if text is None or allowance < 0.0:
                return await self.hang_up()
            self.answering = True
            await self.answer(text)
            self.answering, self.heard = False, clock()

    async def watch(self) -> None:
        """Return once the page has left a frame unconfirmed for too long."""
        clock = asyncio.get_running_loop().time
        while self.answering or not self.in_flight or clock() - self.heard < PATIENCE - 1.0:
            await asyncio.sleep(1.0)
        await self.hang_up()

    async def answer(self, text: str) -> None:
        """Do one wish and say what came of it."""
        async with self.turn:
            try:
                wish = _parse(text)
                if wish == {"op": "seen"}:
                    self.in_flight = max(0, self.in_flight - 1)
                    replies: list[Message] = []
                else:
                    replies = await _aside(self.session.apply, wish)
                    self.owed = True
            except BadInput as error:
                replies = [{"kind": "refused", "error": type(error).__name__, "field": error.field, "text": str(error)}]
            for reply in replies:
                await self.send(_text(reply))
        self.wake.set()
        await self.show()

    async def play(self) -> None:
        """Advance the session as fast as the clock says; cycles that come too late are left out, not made up for."""
        clock = asyncio.get_running_loop().time
        due = clock()
        while True:
            if not self.session.playing:
                self.wake.clear()
                await self.wake.wait()
                due = clock()
                continue
            period = self.session.period
            steps = max(1, round(TICK / period))
            due = max(due + steps * period, clock())
            await asyncio.sleep(due - clock())
            async with self.turn:
                if self.session.playing:
                    await _aside(self.session.advance, steps)
            self.owed = True
            await self.show()

    async def show(self) -> None:
        """Send the present moment if the page has taken what it was sent before; otherwise it is skipped."""
        async with self.turn:
            if self.owed and self.in_flight < IN_FLIGHT:
                if not self.in_flight:
                    self.heard = asyncio.get_running_loop().time()
                self.owed, self.in_flight = False, self.in_flight + 1
                await self.send(await _aside(lambda: _text(self.session.frame())))

    async def hang_up(self) -> None:
        if self.websocket.application_state is WebSocketState.CONNECTED:
            await self.websocket.close(1008)

    async def send(self, text: str) -> None:
        if self.websocket.application_state is not WebSocketState.CONNECTED:
            raise WebSocketDisconnect(1006)
        await asyncio.wait_for(self.websocket.send_text(text), PATIENCE)


async def _aside(work: Callable[..., T], *given: object) -> T:
    """Do work on one of a few threads, so that the server answers others meanwhile."""
    return await asyncio.get_running_loop().run_in_executor(_WORKERS, work, *given)


def _text(message: Message) -> str:
    return json.dumps(message, allow_nan=False, separators=(",", ":"))


def _parse(text: str) -> object:
    try:
        wish = json.loads(text)
    except (ValueError, RecursionError):
        raise BadParameter("message", text[:80], "JSON") from None
    if len(text) > MAX_SMALL and not (isinstance(wish, dict) and wish.get("op") == "open"):
        raise BadParameter("message", f"{len(text)} characters", f"at most {MAX_SMALL} characters")
    return wish
