"""The live page's server on a free port of this machine, for the length of a block."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

import uvicorn
from starlette.types import ASGIApp

from antway.web.server import config_of, make_app, names_of
from antway.web.session import Session
from antway.web.tours import Tours
from antway.web.workers import Workers

TOKEN = "a-token"


@cache
def compile_all() -> None:
    """Have every kernel that the page calls compiled, which on a fresh machine takes longer than a page waits."""
    session = Session()
    for names in (["stop"], ["antway", "paper"]):
        for request in ({"op": "policies", "names": names}, {"op": "step"}, {"op": "ants"}):
            session.apply(request)
    Tours().apply({"op": "step"})


@contextmanager
def served(host: str = "127.0.0.1", port: int | None = None, *, workers: Workers | None = None) -> Iterator[int]:
    """Serve on 127.0.0.1 under the names of `host` and `port` (None: the port that is taken); the port taken is given."""
    compile_all()
    with serving(lambda taken: make_app(names_of(host, port or taken), TOKEN, workers=workers)) as taken:
        yield taken


@contextmanager
def serving(make: Callable[[int], ASGIApp]) -> Iterator[int]:
    """Serve the application that is made for the port taken on 127.0.0.1, which is given."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        taken = listener.getsockname()[1]
        server = uvicorn.Server(config_of(make(taken)))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield taken
        finally:
            server.should_exit = True
            thread.join()


def asked(port: int, request: str) -> bytes:
    """Send a raw request, and return the whole answer."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as wire:
        wire.sendall(request.encode("latin-1"))
        return b"".join(iter(lambda: wire.recv(65536), b""))
