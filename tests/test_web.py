"""The live page's server: who is let in, which files leave, and what a session does."""

from __future__ import annotations

import base64
import json
import socket
import threading
import warnings
from collections.abc import Iterator
from typing import Any

import pytest
import uvicorn
from starlette.websockets import WebSocketDisconnect
from websockets.sync.client import connect

from antway.errors import BadInput
from antway.web.server import make_app, names_of
from antway.web.session import Session

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # newer ones would rather have another client of HTTP below them
    from starlette.testclient import TestClient

TOKEN, PORT = "a-token", 8765
OWN = f"127.0.0.1:{PORT}"
EVIL_HOSTS = [
    "evil.com",
    f"evil.com:{PORT}", f"127.0.0.1.evil.com:{PORT}", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8766", "localhost",
    "localhost:1",
    f"localhost.evil.com:{PORT}", f"[::1]:{PORT + 1}", "[::1]", f"[::2]:{PORT}", f"0.0.0.0:{PORT}",
    f"127.1:{PORT}",
    f"2130706433:{PORT}", f"user@127.0.0.1:{PORT}", f"127.0.0.1:{PORT}.", f"169.254.169.254:{PORT}", "x", "null",
]  # fmt: skip
EVIL_ORIGINS = [
    "null", "http://evil.com", f"http://evil.com:{PORT}", f"https://{OWN}", "http://127.0.0.1", "http://127.0.0.1:1",
    f"http://127.0.0.1.evil.com:{PORT}", f"http://{OWN}.evil.com", f"http://{OWN}/", f"http://evil@{OWN}", "file://", "",
    f"http://localhost:{PORT + 1}", "http://[::1]", f"http://0.0.0.0:{PORT}", f"ws://{OWN}", "chrome-extension://x", "data:",
    f"HTTP://{OWN} http://evil.com", "*",
]  # fmt: skip
TABLE = [(host, f"http://{OWN}") for host in EVIL_HOSTS] + [(OWN, origin) for origin in EVIL_ORIGINS]


@pytest.fixture
def client() -> TestClient:
    return TestClient(make_app(names_of("127.0.0.1", PORT), TOKEN), base_url=f"http://{OWN}")


@pytest.mark.parametrize("host, origin", TABLE)
def test_strangers_are_refused(client: TestClient, host: str, origin: str) -> None:
    """C38: each of 40 wrong hosts and origins gets 403 over HTTP and over a websocket, token or not."""
    headers = {"host": host, "origin": origin}
    assert client.get("/", headers=headers).status_code == 403
    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/live", subprotocols=["antway", TOKEN], headers=headers):
        pass


@pytest.mark.parametrize("protocols", [[], ["antway"], ["antway", "wrong"], [TOKEN, "antway"], ["antway", TOKEN, "x"]])
def test_a_websocket_takes_the_token(client: TestClient, protocols: list[str]) -> None:
    """C38: without the page's token no websocket opens, and no method but GET is served."""
    headers = {"host": OWN, "origin": f"http://{OWN}"}
    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/live", subprotocols=protocols, headers=headers):
        pass
    assert client.post("/", headers={"host": OWN}).status_code == 405


def test_another_host_needs_the_token_for_the_page() -> None:
    """C38: a server for others gives its page to who has the token alone."""
    client = TestClient(make_app(names_of("10.0.0.7", 80), TOKEN, open_page=False), base_url="http://10.0.0.7")
    assert client.get("/").status_code == client.get("/?token=x").status_code == 403
    page = client.get(f"/?token={TOKEN}")
    assert page.status_code == 200 and "default-src 'none'" in page.headers["content-security-policy"]


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        number = listener.getsockname()[1]
        app = make_app(names_of("127.0.0.1", number), TOKEN)
        server = uvicorn.Server(uvicorn.Config(app, log_level="critical", http="h11", ws="websockets-sansio"))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        yield number
        server.should_exit = True
        thread.join()


def test_no_path_leads_outside_the_list_of_files(port: int) -> None:
    """C39: 200 paths sent raw (dots, encodings, backslashes, NUL, absolute, long) are never answered with a file."""
    dots = ["..", "%2e%2e", "%252e%252e", "..;", ".%2e", "%c0%ae%c0%ae", "\\..", "..%00", "....//", "static/.."]
    ends = ["etc/passwd", "page.html", "server.py", "../server.py", "%2fetc%2fpasswd", "\\windows\\win.ini", "session.py%00.js",
            "static/page.js", "__init__.py", "a" * 5000]  # fmt: skip
    paths = [f"/{dot}/{end}" for dot in dots for end in ends] + [f"/static/{dot}/{dot}/{end}" for dot in dots for end in ends]
    assert len(paths) == 200
    for path in paths:
        with socket.create_connection(("127.0.0.1", port), timeout=10) as wire:
            wire.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n".encode("latin-1"))
            answer = b"".join(iter(lambda: wire.recv(65536), b""))
        assert answer.split()[1] in (b"400", b"404"), path
        assert b"root:" not in answer and b"import" not in answer, path


def test_a_websocket_plays(port: int) -> None:
    """A scene and a frame come first; a step moves the time on; a wrong wish is refused in the library's words."""
    own = f"127.0.0.1:{port}"
    with connect(f"ws://{own}/live", origin=f"http://{own}", subprotocols=["antway", TOKEN]) as wire:  # type: ignore[arg-type]
        assert json.loads(wire.recv(60))["kind"] == "scene"
        assert json.loads(wire.recv(60))["lanes"][0]["t"] == 0.0
        wire.send(json.dumps({"op": "step"}))
        assert json.loads(wire.recv(60))["lanes"][0]["t"] == pytest.approx(0.1)
        wire.send("{")
        refusal = {"kind": "refused", "error": "BadParameter", "field": "message", "text": "message = '{': must be JSON"}
        assert json.loads(wire.recv(60)) == refusal


def test_edits_can_be_undone_and_wrong_ones_change_nothing() -> None:
    """Each edit is one step of undo; a refused one leaves scenario and run as they were."""
    session = Session()
    first = session.scenario
    session.apply({"op": "paint", "blocked": True, "cells": [[10, 10], [10, 11]]})
    session.apply({"op": "move", "end": "goal", "xy": [17.5, 17.5]})
    session.apply({"op": "drop", "xy": [5.5, 1.5], "velocity": [0.5, 0.0], "radius": 0.3})
    session.apply({"op": "step"})
    before, lanes = session.scenario, session.lanes
    wrong: list[Any] = [
        None,
        {}, {"op": "paint", "blocked": True, "cells": [[0, 0]]},
        {"op": "paint", "blocked": True, "cells": [[0, 99]]},
        {"op": "set", "field": "robot.radius", "value": 99}, {"op": "set", "field": "seed", "value": 1.5},
        {"op": "policies", "names": ["nobody"]}, {"op": "open", "files": [{"name": "../x.map", "data": ""}]},
        {"op": "open", "files": [{"name": "x.png", "data": base64.b64encode(b"no png").decode()}]},
        {"op": "scene", "name": "/etc"},
    ]  # fmt: skip
    for wish in wrong:
        with pytest.raises(BadInput):
            session.apply(wish)
    assert session.scenario is before and session.lanes is lanes
    for _ in range(3):
        session.apply({"op": "undo"})
    assert session.scenario == first


def test_a_saved_scenario_opens_again_and_frames_are_small() -> None:
    """The saved file gives the same scenario back; two policies play in step within 60 kB a frame."""
    session = Session()
    session.apply({"op": "set", "field": "seed", "value": 7})
    saved = session.apply({"op": "export", "what": "scenario"})[0]
    before = session.scenario
    session.apply({"op": "open", "files": [{"name": saved["name"], "data": saved["base64"]}]})
    assert session.scenario.world == before.world and session.scenario.seed == 7
    session.apply({"op": "policies", "names": ["antway", "paper"]})
    for _ in range(60):
        session.advance(1)
        frame = session.frame()
        assert len(json.dumps(frame, separators=(",", ":"))) <= 60_000
        assert frame["lanes"][0]["t"] == frame["lanes"][1]["t"]
