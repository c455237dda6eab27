"""The live page's server: a fixed list of files over HTTP, one session per websocket; this machine alone unless told otherwise.

Every request is held to the names that the server goes by (Host, against names rebound to it) and to its own pages (Origin,
against other sites). There is nothing to post: a page's wishes come over its websocket, which opens only with the token that
the page was served with. A session lives as long as its socket.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import json
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Mapping
from importlib.resources import files
from typing import Protocol

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from antway import checks
from antway.ants.rules import RULES
from antway.errors import BadInput, BadParameter
from antway.scenes import SCENES
from antway.web import tours
from antway.web.lane import Message
from antway.web.session import PARAMETERS, POLICIES, SPEEDS, Session

PORT = 8765
MAX_MESSAGE = 6 * 2**20  # bytes; an upload in base64
MAX_SMALL = 2**19  # bytes of any other message
MAX_SESSIONS = 256
RATE, BURST = 60.0, 240.0  # messages a second, and at once
IN_FLIGHT = 2  # frames that the page has not confirmed
PATIENCE = 10.0  # s that a send may take before the client is cut off
TICK = 1 / 40  # s between frames at the least

_FILES = {  # path: package, file, type
    "/": ("antway.web", "page.html", "text/html"),
    "/tsp": ("antway.web", "tsp.html", "text/html"),
    "/tsp.js": ("antway.web", "tsp.js", "text/javascript"),
    "/page.css": ("antway.web", "page.css", "text/css"),
    "/page.js": ("antway.web", "page.js", "text/javascript"),
    "/lane.js": ("antway.web", "lane.js", "text/javascript"),
    "/edit.js": ("antway.web", "edit.js", "text/javascript"),
    "/parts.js": ("antway.web", "parts.js", "text/javascript"),
    "/canvas.js": ("antway.view", "canvas.js", "text/javascript"),
    "/layers.js": ("antway.view", "layers.js", "text/javascript"),
    "/replay.css": ("antway.view", "replay.css", "text/css"),
}
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' blob: data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


def is_loopback(host: str) -> bool:
    """Tell whether `host` is this machine and no other."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def names_of(host: str, port: int) -> frozenset[str]:
    """Return what a Host header may say to a server at `host` and `port`."""
    hosts = {"127.0.0.1", "localhost", "[::1]"} if is_loopback(host) else {f"[{host}]" if ":" in host else host.lower()}
    return frozenset({f"{name}:{port}" for name in hosts} | (hosts if port == 80 else set()))


class Tab(Protocol):
    """What is behind one tab: wishes come in, scenes and frames go out; `period` s of the clock make one step."""

    closed: threading.Event
    playing: bool

    @property
    def period(self) -> float: ...
    def apply(self, message: object) -> list[Message]: ...
    def advance(self, steps: int) -> None: ...
    def frame(self) -> Message: ...
    def describe(self) -> Message: ...


class Gate:
    """Lets through what names this server and comes from its own page; all else is answered with 403."""

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self.app, self.names = app, names
        self.origins = frozenset(f"http://{name}" for name in names)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            return await self.app(scope, receive, send)
        hosts, origins = (
            [value.decode("latin-1").lower() for key, value in scope["headers"] if key == name] for name in (b"host", b"origin")
        )
        # A browser names the origin of every websocket, but not that of a plain GET of a page.
        own = origins == [] if scope["type"] == "http" else False
        own = own or (len(origins) == 1 and origins[0] in self.origins)
        ours = own and len(hosts) == 1 and hosts[0] in self.names
        if ours:
            return await self.app(scope, receive, send)
        if scope["type"] == "websocket":
            return await send({"type": "websocket.close", "code": 1008})
        return await PlainTextResponse("this server answers its own page alone\n", 403, _HEADERS)(scope, receive, send)


def make_app(names: frozenset[str], token: str, *, open_page: bool = True) -> ASGIApp:
    """Return the server as an ASGI application.

    Parameters
    ----------
    names : frozenset of str
        What a Host header may say (`names_of`).
    token : str
        What a websocket must bring along.
    open_page : bool
        Whether the page is served, token and all, to whoever asks for it; otherwise it takes ?token=... to get it.
    """
    crossing = {
        "policies": POLICIES,
        "scenes": SCENES,
        "speeds": SPEEDS,
        "parameters": [{name: getattr(p, name) for name in p.__slots__} for p in PARAMETERS],
        "token": token,
    }
    touring = {
        "instances": list(tours.INSTANCES),
        "rules": list(RULES),
        "searches": tours.SEARCHES,
        "persistences": tours.PERSISTENCES,
        "speeds": tours.SPEEDS,
        "token": token,
    }
    pages = {"/": _embedded(crossing), "/tsp": _embedded(touring)}

    def file(path: str) -> Callable[[Request], Awaitable[Response]]:
        package, name, kind = _FILES[path]
        text = (files(package) / "static" / name).read_text(encoding="utf-8").replace("{{choices}}", pages.get(path, ""))

        async def answer(request: Request) -> Response:
            if path in pages and not open_page and not _same(request.query_params.get("token", ""), token):
                return PlainTextResponse("open the address that antway serve printed, with its token\n", 403, _HEADERS)
            return Response(text, 200, _HEADERS, kind)

        return answer

    tabs: set[Tab] = set()

    def live(make: Callable[[], Tab]) -> Callable[[WebSocket], Awaitable[None]]:
        async def play(websocket: WebSocket) -> None:
            offered = websocket.scope.get("subprotocols", [])
            if len(offered) != 2 or offered[0] != "antway" or not _same(offered[1], token) or len(tabs) >= MAX_SESSIONS:
                return await websocket.close(1008)
            await websocket.accept("antway")
            tab = await asyncio.to_thread(make)
            tabs.add(tab)
            try:
                await _Player(websocket, tab).run()
            finally:
                tab.closed.set()
                tabs.discard(tab)

        return play

    routes = [Route(path, file(path), methods=["GET"]) for path in _FILES]
    app = Starlette(routes=[*routes, WebSocketRoute("/live", live(Session)), WebSocketRoute("/tours", live(tours.Tours))])
    app.router.redirect_slashes = False
    return Gate(app, names)


class _Player:
    """Carries wishes to a session and frames back, at the pace of the clock and never ahead of the page."""

    def __init__(self, websocket: WebSocket, session: Tab) -> None:
        self.websocket, self.session = websocket, session
        self.turn, self.wake = asyncio.Lock(), asyncio.Event()
        self.owed, self.in_flight = True, 0

    async def run(self) -> None:
        """Serve until the page is gone, asks too much, or does not take what it is sent."""
        playing = asyncio.create_task(self.play())
        listening = asyncio.create_task(self.listen())
        try:
            await self.send(await asyncio.to_thread(self.session.describe))
            await self.show()
            done, _ = await asyncio.wait({playing, listening}, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except (WebSocketDisconnect, TimeoutError):
            pass
        finally:
            self.session.closed.set()
            for task in (playing, listening):
                task.cancel()
            await asyncio.gather(playing, listening, return_exceptions=True)

    async def listen(self) -> None:
        """Do what the page asks until it is gone or floods."""
        clock = asyncio.get_running_loop().time
        allowance, last = BURST, clock()
        while True:
            message = await self.websocket.receive()
            if message["type"] == "websocket.disconnect":
                return
            now = clock()
            allowance, last = min(BURST, allowance + (now - last) * RATE) - 1.0, now
            text = message.get("text")
            if text is None or allowance < 0.0:
                await self.websocket.close(1008)
                return
            await self.answer(text)

    async def answer(self, text: str) -> None:
        """Do one wish and say what came of it."""
        async with self.turn:
            try:
                wish = _parse(text)
                if wish == {"op": "seen"}:
                    self.in_flight = max(0, self.in_flight - 1)
                    replies: list[Message] = []
                else:
                    replies = await asyncio.to_thread(self.session.apply, wish)
                    self.owed = True
            except BadInput as error:
                replies = [{"kind": "refused", "error": type(error).__name__, "field": error.field, "text": str(error)}]
            for reply in replies:
                await self.send(reply)
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
                    await asyncio.to_thread(self.session.advance, steps)
            self.owed = True
            await self.show()

    async def show(self) -> None:
        """Send the present moment if the page has taken what it was sent before; otherwise it is skipped."""
        async with self.turn:
            if self.owed and self.in_flight < IN_FLIGHT:
                self.owed, self.in_flight = False, self.in_flight + 1
                await self.send(self.session.frame())

    async def send(self, message: Message) -> None:
        text = json.dumps(message, allow_nan=False, separators=(",", ":"))
        await asyncio.wait_for(self.websocket.send_text(text), PATIENCE)


def _parse(text: str) -> object:
    try:
        wish = json.loads(text)
    except (ValueError, RecursionError):
        raise BadParameter("message", text[:80], "JSON") from None
    if len(text) > MAX_SMALL and not (isinstance(wish, dict) and wish.get("op") == "open"):
        raise BadParameter("message", f"{len(text)} characters", f"at most {MAX_SMALL} characters")
    return wish


def _embedded(choices: Mapping[str, object]) -> str:
    """Return JSON that is safe within a page."""
    return json.dumps(choices).replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _same(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(), other.encode())


def serve(host: str = "127.0.0.1", port: int = PORT, *, ready: Callable[[str], None] = lambda url: None) -> None:
    """Serve the page until interrupted.

    Parameters
    ----------
    host : str
        An address or a name of this machine. Any but a loopback address opens the page to others, who need the token.
    port : int
        0: any that is free.
    ready : callable
        Told the address of the page once the port is taken.

    Raises
    ------
    BadParameter
        For a host or port that cannot be had.
    """
    port = checks.integer("port", port, low=0, high=65535)
    wild = host.strip("[]") in ("", "0.0.0.0", "::", "*")
    if wild:
        raise BadParameter("host", host, "one address or name of this machine, by which others call it")
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listener = socket.create_server((host, port), family=family)
    except OSError as error:
        raise BadParameter("host:port", f"{host}:{port}", f"free, and of this machine ({error.strerror or error})") from None
    with listener:
        port = listener.getsockname()[1]
        token, alone = secrets.token_urlsafe(24), is_loopback(host)
        app = make_app(names_of(host, port), token, open_page=alone)
        config = uvicorn.Config(
            app,
            log_level="warning",
            ws="websockets-sansio",
            ws_max_size=MAX_MESSAGE,
            ws_per_message_deflate=False,
            h11_max_incomplete_event_size=16384,
            http="h11",
            timeout_keep_alive=5,
            timeout_graceful_shutdown=2,
            server_header=False,
        )
        url = f"http://{f'[{host}]' if ':' in host else host}:{port}/"
        server = uvicorn.Server(config)
        ready(url if alone else f"{url}?token={token}")
        server.run(sockets=[listener])
