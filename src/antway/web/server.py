"""The server of the live page: a fixed list of files over HTTP and a session for each websocket, by default only local.

Every request must name this server (its Host header, which stops DNS rebinding) and come from its own pages (its Origin header,
which stops other sites). The page is served only with the token that `antway serve` prints. There are no POST requests: a page
sends its requests over its websocket, which opens only with that token. A session lives as long as its socket.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import json
import resource
import secrets
import socket
import zlib
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import asdict
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from antway import checks
from antway.ants.rules import RULES
from antway.errors import BadParameter
from antway.scenes import ROUNDS, SCENES
from antway.tables import ABOUT
from antway.view.pages import asset, embedded, filled
from antway.web import tours
from antway.web.player import TIMEOUT, Player, Turns
from antway.web.session import PARAMETERS, POLICIES, Session
from antway.web.tab import Tab
from antway.web.workers import Workers

PORT = 8765
MAX_MESSAGE = 6 * 2**20  # limit of bytes of a message; the largest is an upload in base64
MAX_SESSIONS = 256
MAX_HEAD = 2**16  # limit of bytes of an HTTP request
CLOSING = 2.0  # s; time for a page to confirm that its websocket is closed
EXPORTS = 8  # number of threads that wait for files and exports from other processes
MAX_FILES = 8192  # number of sockets and files open at once, if the system allows it

_FILES = {  # the scripts and styles that are served, by package
    "antway.web": ("tsp.js", "page.css", "page.js", "view.js", "edit.js", "keep.js", "terms.js", "parts.js"),
    "antway.view": ("canvas.js", "common.js", "layers.js", "replay.css"),
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
    """Tell whether `host` names this machine's loopback interface."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_wildcard(host: str) -> bool:
    """Tell whether `host`, in any notation ("0", "0x0", "::0"), means all addresses of this machine."""
    name = host.strip("[]")
    if name in ("", "*"):
        return True
    try:
        found = socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return False  # an invalid name, which is refused later
    return any(ipaddress.ip_address(str(address[0]).partition("%")[0]).is_unspecified for *_, address in found)


def names_of(host: str, port: int) -> frozenset[str]:
    """Return the allowed Host headers of a server at `host` and `port`."""
    try:
        own = str(ipaddress.ip_address(host))  # as browsers write it
    except ValueError:
        own = host.lower()
    hosts = {f"[{own}]" if ":" in own else own} | ({"127.0.0.1", "localhost", "[::1]"} if is_loopback(host) else set())
    return frozenset({f"{name}:{port}" for name in hosts} | (hosts if port == 80 else set()))


class Gate:
    """Passes on requests that name this server and come from its own page; all others are answered with 403.

    `files` are complete answers to a GET of their paths: `Prompt` writes them directly, without the framework.
    """

    def __init__(self, app: ASGIApp, names: frozenset[str], turns: Turns, files: Mapping[str, bytes]) -> None:
        self.app, self.names, self.turns, self.files = app, names, turns, files
        self.origins = frozenset(f"http://{name}" for name in names)

    def is_ours(self, scope: Scope) -> bool:
        """Tell whether a request names this server and comes from its own page."""
        hosts, origins = (
            [value.decode("latin-1").lower() for key, value in scope["headers"] if key == name] for name in (b"host", b"origin")
        )
        # A browser sends the origin of every websocket, but not that of a plain GET of a page.
        own = len(origins) == 1 and origins[0] in self.origins
        own = own or (not origins and scope["type"] == "http")
        return own and len(hosts) == 1 and hosts[0] in self.names

    def at_once(self, scope: Scope) -> bytes:
        """Return the complete answer to a GET of a fixed file; nothing for any other request."""
        if scope["method"] != "GET" or scope["path"] not in self.files or not self.is_ours(scope):
            return b""
        self.turns.request()
        return self.files[scope["path"]]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            return await self.app(scope, receive, send)
        self.turns.request()
        if self.is_ours(scope):
            return await self.app(scope, receive, send if scope["type"] == "websocket" else _with_headers(send))
        if scope["type"] == "websocket":
            return await send({"type": "websocket.close", "code": 1008})
        return await PlainTextResponse("this server answers only its own page\n", 403, _HEADERS)(scope, receive, send)


def _with_headers(send: Send) -> Send:
    """Return a `send` that adds missing security headers, as in the framework's own answers."""

    async def sending(message: Any) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, text in _HEADERS.items():
                headers.setdefault(name, text)
        await send(message)

    return sending


def make_app(names: frozenset[str], token: str, *, workers: Workers | None = None) -> ASGIApp:
    """Return the server as an ASGI application, whose allowed Host headers are `names`, as of `names_of`.

    A websocket needs the token as its second subprotocol, and a request for a page as ?token=... or, later, in a cookie: even
    on this machine there may be other users. `workers` read files and make exports for the tabs; without them the server does.
    """
    cookie = f"antway-{zlib.crc32(token.encode()):08x}"  # a different name for each server, because cookies ignore ports
    crossings = {
        "token": token,
        "policies": POLICIES,
        "about": {name: ABOUT["policies"][name] for name in POLICIES},
        "scenes": (*SCENES, *ROUNDS),
        "speeds": Session.SPEEDS,
        "parameters": [asdict(parameter) for parameter in PARAMETERS],
    }
    of_tours = {
        "token": token,
        "instances": list(tours.INSTANCES),
        "rules": list(RULES),
        "searches": tours.SEARCHES,
        "persistences": tours.PERSISTENCES,
        "speeds": tours.Tours.SPEEDS,
    }
    pages = {
        "/": _page("antway", "page.html", "/page.js", crossings),
        "/tsp": _page("Tours – antway", "tsp.html", "/tsp.js", of_tours),
    }
    fixed = {f"/{name}": _answer(asset(name, package), name) for package, names in _FILES.items() for name in names}

    def with_token(page: Response) -> Callable[[Request], Awaitable[Response]]:
        async def answer(request: Request) -> Response:
            if _same(request.query_params.get("token", ""), token):
                granted = Response(page.body, 200, _HEADERS, page.media_type)
                granted.set_cookie(cookie, token, httponly=True, samesite="strict")
                return granted
            if _same(request.cookies.get(cookie, ""), token):
                return page
            return PlainTextResponse("open the address that antway serve printed, with its token\n", 403, _HEADERS)

        return answer

    turns, exports, open_tabs = Turns(), Turns(EXPORTS), set[WebSocket]()

    def live(make: Callable[[], Tab]) -> Callable[[WebSocket], Awaitable[None]]:
        async def play(websocket: WebSocket) -> None:
            offered = websocket.scope.get("subprotocols", [])
            if len(offered) != 2 or offered[0] != "antway" or not _same(offered[1], token) or len(open_tabs) >= MAX_SESSIONS:
                return await websocket.close(1008)
            open_tabs.add(websocket)
            try:
                await websocket.accept("antway")
                tab = await turns.take(make)
                tab.workers = workers
                await Player(websocket, tab, turns, exports).run()
            except (asyncio.CancelledError, WebSocketDisconnect):
                pass  # the server ends, or the page was left at once
            finally:
                open_tabs.discard(websocket)

        return play

    answers: dict[str, Callable[..., Any]] = {**{path: with_token(page) for path, page in pages.items()}, **fixed}
    routes = [Route(path, answer, methods=["GET"]) for path, answer in answers.items()]
    app = Starlette(routes=[*routes, WebSocketRoute("/live", live(Session)), WebSocketRoute("/tours", live(tours.Tours))])
    app.router.redirect_slashes = False
    whole = {path: _lines(answer.raw_headers) + b"\r\n" + bytes(answer.body) for path, answer in fixed.items()}
    return Gate(app, names, turns, whole)


def _answer(text: str, name: str) -> Response:
    """Return the answer to a request for a file of this name."""
    kind = {"html": "html", "js": "javascript", "css": "css"}[name.rpartition(".")[2]]
    return Response(text, 200, _HEADERS, f"text/{kind}")


def _page(title: str, body: str, script: str, choices: Mapping[str, object]) -> Response:
    """Return a page, made of what all have in common, the file `body`, and the `choices` for its script."""
    parts = {"title": title, "body": asset(body, "antway.web"), "script": script, "choices": embedded(json.dumps(choices))}
    return _answer(filled(asset("shell.html", "antway.web"), parts), body)


def _lines(headers: Iterable[tuple[bytes, bytes]]) -> bytes:
    return b"".join(name + b": " + value + b"\r\n" for name, value in headers)


def _same(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(), other.encode())


class Unstuck:
    """A connection that is closed `TIMEOUT` s after the other side stops reading."""

    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport

    def pause_writing(self) -> None:
        super().pause_writing()  # type: ignore[misc]
        self.stuck = self.loop.call_later(TIMEOUT, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()  # type: ignore[misc]
        self.stuck.cancel()


class Wire(Unstuck, WebSocketsSansIOProtocol):
    """A websocket to a page, which is cut if the page does not confirm that it is closed."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.close_timeout = CLOSING

    async def send(self, message: Any) -> None:
        """Send a message of the application, unless uvicorn has closed the connection itself."""
        await self.writable.wait()
        if self.handshake_complete and self.close_sent and self.close_timer is None:
            raise ClientDisconnected
        await super().send(message)


class Prompt(Unstuck, HttpToolsProtocol):
    """HTTP that cuts a connection if a request is incomplete after `TIMEOUT` s, or has more than `MAX_HEAD` bytes.

    The time starts with the connection and with the first byte of each request; uvicorn limits the pauses between requests.
    """

    waiting: asyncio.TimerHandle | None = None
    head = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.expect()

    def expect(self) -> None:
        """Give the other side `TIMEOUT` s from now, unless its time already runs."""
        if self.waiting is None:
            self.waiting = self.loop.call_later(TIMEOUT, self.give_up)

    def on_message_begin(self) -> None:
        super().on_message_begin()
        self.expect()

    def on_message_complete(self) -> None:
        super().on_message_complete()
        self.settle()

    def _start_asgi_task(self, cycle: Any, app: Any) -> None:
        """Answer a request: directly for a fixed file if nothing else waits to be written, else by the application."""
        file = b"" if self.pipeline or self.flow.write_paused or not isinstance(app, Gate) else app.at_once(cycle.scope)
        if not file:
            return super()._start_asgi_task(cycle, app)
        close = [] if cycle.keep_alive else [(b"connection", b"close")]
        self.transport.write(STATUS_LINE[200] + _lines([*cycle.default_headers, *close]) + file)
        cycle.response_started = cycle.response_complete = True
        if close:
            self.transport.close()
        cycle.on_response()
        return None

    def settle(self) -> None:
        """Record that a request is complete, or that the connection is closed."""
        if self.waiting is not None:
            self.waiting.cancel()
        self.waiting, self.head = None, 0

    def connection_lost(self, exc: Exception | None) -> None:
        self.settle()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        self.expect()
        self.head += len(data)
        if self.head > MAX_HEAD:
            self.transport.close()
        else:
            super().data_received(data)

    def give_up(self) -> None:
        if self.transport.get_protocol() is self:
            self.transport.abort()


def config_of(app: ASGIApp) -> uvicorn.Config:
    """Return the server's configuration: small requests, bounded messages, short-lived connections."""
    return uvicorn.Config(
        app,
        log_level="error",
        access_log=False,
        proxy_headers=False,  # there is no proxy
        http=Prompt,
        ws=Wire,
        ws_max_size=MAX_MESSAGE,
        ws_per_message_deflate=False,
        timeout_keep_alive=5,
        timeout_graceful_shutdown=2,
        server_header=False,
    )


def _allow_files() -> None:
    """Raise the limit of open sockets as far as allowed."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_FILES if hard == resource.RLIM_INFINITY else min(MAX_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def serve(host: str = "127.0.0.1", port: int = PORT, *, ready: Callable[[str], None] = lambda url: None) -> None:
    """Serve the page until interrupted.

    Parameters
    ----------
    host : str
        An address or a name of this machine. Any but a loopback address opens the page to other machines. The token is always
        needed.
    port : int
        0 means any free port.
    ready : callable
        Called with the address of the page, which includes the token, once the port is open.

    Raises
    ------
    BadParameter
        If the host or port cannot be used.
    """
    port = checks.integer("port", port, low=0, high=65535)
    if is_wildcard(host):
        raise BadParameter("host", host, "one address or name of this machine, by which others call it")
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listener = socket.create_server((host, port), family=family)
    except OSError as error:
        why = str(error.strerror or error).partition(" (while")[0]  # which Python adds, and which names the same again
        raise BadParameter("host:port", f"{host}:{port}", f"free, and of this machine ({why})") from None
    with listener:
        port = listener.getsockname()[1]
        token, workers = secrets.token_urlsafe(24), Workers()
        app = make_app(names_of(host, port), token, workers=workers)
        _allow_files()
        url = f"http://{f'[{host}]' if ':' in host else host}:{port}/"
        server = uvicorn.Server(config_of(app))
        ready(f"{url}?token={token}")
        try:
            server.run(sockets=[listener])
        finally:
            workers.close()
