"""The live page's server: who is let in, which files leave, and what a session does."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import re
import socket
import time
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image
from starlette.websockets import WebSocketState
from websockets.sync.client import connect

from antway import Decision, Grid, RobotSpec, Scenario, World, save_map
from antway.errors import BadInput, TooLarge
from antway.web import session as sessions
from antway.web.files import MAX_OBSTACLES, decoded, exported, read_upload
from antway.web.player import SLICE, Player, Turns
from antway.web.server import Gate, names_of, serve
from antway.web.session import Session
from antway.web.view import Look
from antway.world.episode import Episode
from antway.world.motions import Bounce
from antway.world.sensor import Sensor
from antway.world.world import Obstacle
from common import cases, play
from sample import sample_trace
from serving import TOKEN, asked, served

PORT = 8765
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


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with served() as number:
        yield number


@pytest.fixture(scope="module")
def fixed() -> Iterator[int]:
    """A server that goes by the names of port 8765, wherever it is."""
    with served(port=PORT) as number:
        yield number


def status(port: int, host: str, origin: str | None = None, path: str = f"/?token={TOKEN}", method: str = "GET") -> int:
    """The status that a request with these headers is answered with."""
    lines = [f"{method} {path} HTTP/1.1", f"Host: {host}", "Connection: close"]
    lines += [] if origin is None else [f"Origin: {origin}"]
    return int(asked(port, "\r\n".join((*lines, "", ""))).split()[1])


def handshake(port: int, host: str, origin: str | None, *protocols: str) -> int:
    """The status that the opening of a websocket is answered with."""
    lines = ["GET /live HTTP/1.1", f"Host: {host}", "Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13"]
    lines += [f"Sec-WebSocket-Key: {base64.b64encode(bytes(16)).decode()}"]
    lines += [] if origin is None else [f"Origin: {origin}"]
    lines += [f"Sec-WebSocket-Protocol: {', '.join(protocols)}"] if protocols else []
    with socket.create_connection(("127.0.0.1", port), timeout=10) as wire:
        wire.sendall("\r\n".join((*lines, "", "")).encode("latin-1"))
        return int(wire.recv(100).split()[1])


@pytest.mark.parametrize("host, origin", TABLE)
def test_strangers_are_refused(fixed: int, host: str, origin: str) -> None:
    """C38: each of 40 wrong hosts and origins gets 403 over HTTP and over a websocket, token or not."""
    assert status(fixed, host, origin) == handshake(fixed, host, origin, "antway", TOKEN) == 403


def test_the_page_itself_is_let_in(fixed: int) -> None:
    """C38: the server's own names and origins pass, and a websocket without an origin, which no browser sends, does not."""
    for host in (OWN, f"localhost:{PORT}", f"LOCALHOST:{PORT}", f"[::1]:{PORT}"):
        assert status(fixed, host) == status(fixed, host, f"http://{host}") == 200
        assert handshake(fixed, host, f"http://{host}", "antway", TOKEN) == 101
    assert handshake(fixed, OWN, None, "antway", TOKEN) == 403


@pytest.mark.parametrize("protocols", [[], ["antway"], ["antway", "wrong"], [TOKEN, "antway"], ["antway", TOKEN, "x"]])
def test_a_websocket_takes_the_token(fixed: int, protocols: list[str]) -> None:
    """C38: without the page's token no websocket opens, and no method but GET is served."""
    assert handshake(fixed, OWN, f"http://{OWN}", *protocols) == 403
    assert status(fixed, OWN, method="POST") == status(fixed, OWN, method="PUT") == 405


@pytest.mark.parametrize("host", ["10.0.0.7", "127.0.0.1"])
def test_a_page_needs_the_token(host: str) -> None:
    """C38: a page goes to who has the token alone, on this machine too, and to his cookie from then on."""
    with served(host, 80) as port:
        for path in ("/", "/tsp", "/?token=x", "/tsp?token="):
            assert status(port, host, path=path) == 403
        head = f"Host: {host}\r\nConnection: close\r\n"
        page = asked(port, f"GET /?token={TOKEN} HTTP/1.1\r\n{head}\r\n")
        assert page.split()[1] == b"200" and b"content-security-policy: default-src 'none'" in page
        (cookie,) = re.findall(rb"set-cookie: ([^;]+); HttpOnly; Path=/; SameSite=strict", page)
        for path in ("/", "/tsp"):
            again = asked(port, f"GET {path} HTTP/1.1\r\n{head}Cookie: {cookie.decode()}\r\n\r\n")
            assert again.split()[1] == b"200" and b"set-cookie" not in again
            wrong = asked(port, f"GET {path} HTTP/1.1\r\n{head}Cookie: {cookie.decode()[:-1]}\r\n\r\n")
            assert wrong.split()[1] == b"403"


def test_every_answer_has_the_security_headers(port: int) -> None:
    """D14: what is not found and what may not be asked has them, too."""
    for method, path, expected in (("GET", "/nowhere", 404), ("POST", "/", 405), ("GET", "/", 403), ("GET", "/page.js", 200)):
        answer = asked(port, f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n")
        assert int(answer.split()[1]) == expected
        for header in (b"content-security-policy: default-src 'none'", b"x-content-type-options: nosniff", b"no-referrer"):
            assert answer.lower().count(header) == 1, (path, header)


def test_a_file_written_at_once_is_the_answer_of_the_framework(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fixed files leave without a task; the answers are the framework's, kept alive, in HTTP 1.0 and pipelined too."""

    def answers() -> list[list[bytes]]:
        own, kept = f"Host: 127.0.0.1:{port}\r\n", []
        for path in ("/page.js", "/page.css", "/tsp.js", "/nowhere"):
            one = f"GET {path} HTTP/1.1\r\n{own}"
            kept.append(asked(port, f"{one}Connection: close\r\n\r\n"))
            kept.append(asked(port, f"GET {path} HTTP/1.0\r\n{own}\r\n"))
            kept.append(asked(port, f"{one}Origin: http://elsewhere.org\r\nConnection: close\r\n\r\n"))
            page = f"GET /?token={TOKEN} HTTP/1.1\r\n{own}\r\n"
            kept.append(asked(port, f"{one}\r\n{one}\r\n{page}{one}\r\n{one}\r\n{one}Connection: close\r\n\r\n"))
        return [sorted(re.sub(rb"date: [^\r]+", b"date", answer).split(b"\r\n")) for answer in kept]  # headers in any order

    at_once, made = Gate.at_once, []
    monkeypatch.setattr(Gate, "at_once", lambda gate, scope: made.append(at_once(gate, scope)) or made[-1])
    written = answers()
    assert sum(map(bool, made)) >= 3 * 4, "the override of uvicorn's method is called"
    assert all(b"".join(answer).count(b"HTTP/1.1 ") == count for answer, count in zip(written, [1, 1, 1, 6] * 4, strict=True))
    monkeypatch.setattr(Gate, "at_once", lambda gate, scope: b"")
    assert written == answers()


@pytest.mark.parametrize("host", ["0", "0x0", "0.0", "0.0.0.0", "::", "[::]", "::0", "0:0:0:0:0:0:0:0", "", "*"])
def test_no_wildcard_is_served(host: str) -> None:
    """D14: however it is written, an address that means all of them is refused."""
    with pytest.raises(BadInput, match="host"):
        serve(host, 0, ready=lambda url: pytest.fail("it listens"))


def test_a_host_that_cannot_be_used_is_named_once() -> None:
    """What Python adds to the system's words, the address a second time, is left out."""
    with pytest.raises(BadInput, match=r"^host:port = '192\.0\.2\.1:0': must be free, and of this machine \([^()]*\)$"):
        serve("192.0.2.1", 0, ready=lambda url: pytest.fail("it listens"))


def test_undo_keeps_no_more_than_its_budget_of_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """D14: strokes on a large map drop the oldest ones."""
    most, session = 3 * 2**20, Session()
    monkeypatch.setattr(sessions, "MAX_UNDO_BYTES", most)
    session._open(Scenario(World(Grid(np.zeros((1000, 1000), bool))), (1.5, 1.5), (998.5, 998.5), name="large"))
    for k in range(most // 1_000_000 + 5):
        session.apply({"op": "paint", "blocked": True, "runs": [[500, 10 + k, 10 + k]]})
    assert sum(one.world.grid.blocked.nbytes for one in session.history) <= most
    assert len(session.history) > 2 and session.scenario.world.grid.blocked[500, 10 + k]
    session.apply({"op": "undo"})
    assert not session.scenario.world.grid.blocked[500, 10 + k]


def test_a_tab_plays_a_slice_at_a_time() -> None:
    """D11: however short its control period, a tab's turn ends soon, for others wait."""
    session = Session()
    session._open(replace(session.scenario, robot=replace(session.scenario.robot, dt=1e-4), horizon=60.0))
    session.apply({"op": "play", "on": True})
    for steps in (2, 25_000):
        started = time.perf_counter()
        Player.moment(SimpleNamespace(session=session), steps, False)  # type: ignore[arg-type]
    assert 2 < session.views[0].episode.steps < 25_000 and time.perf_counter() - started < 20 * SLICE


def test_no_path_leads_outside_the_list_of_files(port: int) -> None:
    """C39: 200 paths sent raw (dots, encodings, backslashes, NUL, absolute, long) are never answered with a file."""
    dots = ["..", "%2e%2e", "%252e%252e", "..;", ".%2e", "%c0%ae%c0%ae", "\\..", "..%00", "....//", "static/.."]
    ends = ["etc/passwd", "page.html", "server.py", "../server.py", "%2fetc%2fpasswd", "\\windows\\win.ini", "session.py%00.js",
            "static/page.js", "__init__.py", "a" * 5000]  # fmt: skip
    paths = [f"/{dot}/{end}" for dot in dots for end in ends] + [f"/static/{dot}/{dot}/{end}" for dot in dots for end in ends]
    assert len(paths) == 200
    for path in paths:
        answer = asked(port, f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n")
        assert answer.split()[1] in (b"400", b"404"), path
        assert b"root:" not in answer and b"import" not in answer, path


def test_a_websocket_plays(port: int) -> None:
    """A scene and a frame come first; a step moves the time on; a wrong request is refused in the library's words."""
    own = f"127.0.0.1:{port}"
    with connect(f"ws://{own}/live", origin=f"http://{own}", subprotocols=["antway", TOKEN]) as wire:  # type: ignore[arg-type]
        assert json.loads(wire.recv(60))["kind"] == "scene"
        assert json.loads(wire.recv(60))["views"][0]["t"] == 0.0
        wire.send(json.dumps({"op": "step"}))
        assert json.loads(wire.recv(60))["views"][0]["t"] == pytest.approx(0.1)
        wire.send("{")
        text = "message = '{': must be JSON"
        refusal = {"kind": "refused", "error": "BadParameter", "field": "message", "number": None, "text": text}
        assert json.loads(wire.recv(60)) == refusal
        wire.send(json.dumps({"op": "set", "field": "robot.radius", "value": 2.0, "number": 3}))
        while (message := json.loads(wire.recv(60)))["kind"] != "refused":
            pass
        assert (message["number"], message["field"]) == (3, "start"), "which request it was, and what is wrong then"


def test_edits_can_be_undone_and_wrong_ones_change_nothing() -> None:
    """Each edit is one step of undo; a refused one leaves scenario and run as they were."""
    session = Session()
    first = session.scenario
    session.apply({"op": "paint", "blocked": True, "runs": [[18, 1, 2]]})
    session.apply({"op": "move", "end": "goal", "xy": [17.5, 17.5]})
    session.apply({"op": "drop", "xy": [5.5, 1.5], "velocity": [0.5, 0.0], "radius": 0.3})
    session.apply({"op": "step"})
    before, views = session.scenario, session.views
    wrong: list[Any] = [
        None,
        {}, {"op": "paint", "blocked": True, "runs": [[0, 0, 0]]},
        {"op": "paint", "blocked": True, "runs": [[0, 99, 99]]},
        {"op": "set", "field": "robot.radius", "value": 99}, {"op": "set", "field": "seed", "value": 1.5},
        {"op": "policies", "names": ["nobody"]}, {"op": "open", "files": [{"name": "../x.map", "data": ""}]},
        {"op": "open", "files": [{"name": "x.png", "data": base64.b64encode(b"no png").decode()}]},
        {"op": "scene", "name": "/etc"},
    ]  # fmt: skip
    for request in wrong:
        with pytest.raises(BadInput):
            session.apply(request)
    assert session.scenario is before and session.views is views
    for _ in range(3):
        session.apply({"op": "undo"})
    assert session.scenario == first


def test_what_is_missing_or_too_large_is_said_to_users_of_the_page(tmp_path) -> None:
    """A scenario without its map, and without the map's picture, asks for what is missing; no limit is explained for Python."""
    save_map(Grid(np.zeros((9, 9), dtype=bool)), tmp_path / "hall.yaml")
    (tmp_path / "hall.toml").write_text("map = 'hall.yaml'\nstart = [1.5, 1.5]\ngoal = [7.5, 7.5]\n")
    np.save(tmp_path / "big.npy", np.zeros((1500, 1500), dtype=bool))

    def opened(*names: str) -> None:
        read_upload([{"name": one, "data": base64.b64encode((tmp_path / one).read_bytes()).decode()} for one in names])

    opened("hall.toml", "hall.yaml", "hall.pgm")
    for names, missing in ((("hall.toml",), "hall.yaml"), (("hall.toml", "hall.yaml"), "hall.pgm")):
        with pytest.raises(BadInput, match=f"{missing}': must be selected as well"):
            opened(*names)
    with pytest.raises(TooLarge, match=r"at most 1048576 cells$"):
        opened("big.npy")


def test_a_saved_scenario_opens_again_and_frames_are_small() -> None:
    """The saved file gives the same scenario back; two policies play in step within 60 kB a frame."""
    session = Session()
    session.apply({"op": "set", "field": "seed", "value": 2**53 - 1})
    saved = session.apply({"op": "export", "what": "scenario"})[0]
    before = session.scenario
    session.apply({"op": "open", "files": [{"name": saved["name"], "data": saved["base64"]}]})
    assert session.scenario.world == before.world and session.scenario.seed == 2**53 - 1
    session.apply({"op": "policies", "names": ["antway", "paper"]})
    for _ in range(60):
        session.advance()
        frame = session.frame()
        assert len(json.dumps(frame, separators=(",", ":"))) <= 60_000
        assert frame["views"][0]["t"] == frame["views"][1]["t"]


def test_frames_of_the_largest_place_are_small() -> None:
    """As many obstacles as a page may have, all sensed with noise, on 200 x 200 cells, two policies: at most 60 kB a frame."""
    rng, session = np.random.default_rng(1), Session()
    room = Grid(np.zeros((200, 200), bool), 0.25)
    places = rng.uniform(5.0, 45.0, (MAX_OBSTACLES, 2)).tolist()
    obstacles = tuple(Obstacle(0.4, Bounce((x, y), 0.8, float(rng.uniform(-3.1, 3.1)))) for x, y in places)
    robot = RobotSpec(sensor_range=100.0)
    sensor = Sensor(occlusion=False, noise=0.05)
    session._open(Scenario(World(room, obstacles), (1.0, 1.0), (49.0, 49.0), robot, sensor))
    session.apply({"op": "policies", "names": ["antway", "paper"]})
    for _ in range(20):
        session.advance()
        frame = session.frame()
        assert len(json.dumps(frame, separators=(",", ":"))) <= 60_000
        assert len(frame["views"][0]["tubes"]) == MAX_OBSTACLES


def test_predictions_grow_with_time_and_with_noise() -> None:
    """A tube goes on as its obstacle does for 3 s, wider all the time, and wider yet where the sensor is noisy."""
    widths = []
    for noise in (0.0, 0.2):
        session = Session()
        obstacle = Obstacle(0.4, Bounce((5.0, 5.0), 0.8, 0.0))
        place = World(Grid(np.zeros((40, 40), bool), 0.5), (obstacle,))
        sensor = Sensor(occlusion=False, noise=noise)
        session._open(Scenario(place, (1.0, 1.0), (19.0, 19.0), RobotSpec(sensor_range=50.0), sensor))
        session.advance()
        ((radius, growth, path),) = session.frame()["views"][0]["tubes"]
        assert growth > 0.0 and path[0][0] == 0.0 and path[-1][0] == pytest.approx(3.0)
        widths.append(radius)
        if not noise:
            (x, y), (_, end, high) = session.views[0].episode.stage.timeline.at(0.1)[0][0], path[-1]
            assert (end - x, high - y) == pytest.approx((3 * 0.8, 0.0), abs=0.01)
    assert widths[0] == pytest.approx(0.4) and widths[1] > 0.5


def test_the_braking_area_is_the_way_to_a_stand() -> None:
    """A robot that stands needs no way; one that drives needs what it drives until it stands, braked after a control period."""
    session = Session()
    assert session.frame()["views"][0]["braking"][0] == 0.0
    play(session, 15)
    view = session.frame()["views"][0]
    robot, driven, speed = session.scenario.robot, 0.0, view["speed"]
    assert speed > 0.5
    while speed > 1e-6:
        driven += speed * robot.dt
        speed = max(0.0, speed - robot.a_max * robot.dt)
    assert view["braking"][0] == pytest.approx(driven, abs=0.01)


def test_a_spoilt_archive_is_refused() -> None:
    """Archives with wrong bytes, cut short, or packed by methods that could ask for gigabytes: opened or refused, no more."""
    rng = np.random.default_rng(0)
    places = "type octile\nheight 8\nwidth 8\nmap\n" + "........\n" * 8
    refused = set()
    for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", method) as archive:
            archive.writestr("a.map", places)
            archive.writestr("b.txt", rng.bytes(300))
        for _ in range(cases(300, 30_000)):
            data = bytearray(buffer.getvalue())
            for place in rng.integers(len(data), size=rng.integers(1, 5)):
                data[place] = rng.integers(256)
            spoilt = bytes(data[: rng.integers(len(data))] if rng.random() < 0.1 else data)
            try:
                read_upload([{"name": "x.zip", "data": base64.b64encode(spoilt).decode()}])
            except BadInput as error:
                refused.add(error.field)
    assert "zip" in refused


def test_a_look_inside_a_cycle_changes_nothing() -> None:
    """Looking at ant cycles leaves the run as it is, ends where the control cycle does, and then plays the cycle."""
    session = Session()
    session.apply({"op": "policies", "names": ["paper", "antway"]})
    looks, idle, before = 0, 0, []
    while not session.ended and session.views[0].episode.steps < 120:
        steps = session.views[0].episode.steps
        session.apply({"op": "ants"})
        frame = session.frame()
        looked = [view["ants"] for view in frame["views"]]
        looks += any(looked)
        announced = [view["idle"] for view in frame["views"]]
        assert not any(look and why for look, why in zip(looked, announced)), (looked, announced)
        if not any(looked) and not any(before):
            assert all("No ants in this control cycle" in why for why in announced)
            idle += 1
        before = looked
        assert (session.views[0].episode.steps > steps) == (not any(looked))
    assert looks > 20 and idle > 20
    looked_into = session.views
    session.apply({"op": "policies", "names": ["stop"]})
    session.apply({"op": "ants"})
    assert session.frame()["views"][0]["idle"] == "This policy has no ants."
    session.apply({"op": "step"})
    assert session.frame()["views"][0]["idle"] == ""
    session.apply({"op": "policies", "names": ["paper", "antway"]})
    for view, policy in zip(looked_into, session.policies):
        plain = Episode(session.scenario, policy)
        for _ in range(view.episode.steps):
            plain.step()
        assert (plain.stage.xy == view.episode.stage.xy).all(), policy


def test_tabs_that_use_common_memory_do_not_meet() -> None:
    """Three tabs on two maps, played in turn on one thread, each play as they would alone."""
    tabs = [Session() for _ in range(3)]
    tabs[1].apply({"op": "set", "field": "seed", "value": 3})
    tabs[2].apply({"op": "scene", "name": "office"})
    for k in range(120):
        for tab in tabs:
            tab.advance()
            if k % 20 == 19:
                tab.views[0].look_inside()
    for tab in tabs:
        plain, view = Episode(tab.scenario, "antway"), tab.views[0].episode
        for _ in range(view.steps):
            plain.step()
        assert view.steps > 80 and (plain.stage.xy == view.stage.xy).all()
    assert tabs[0].views[0].policy.memory() is tabs[1].views[0].policy.memory()  # type: ignore[attr-defined]


def test_looking_back_shows_what_was_and_changes_nothing() -> None:
    """Every moment is told as it was when it was new; a run that was looked back at goes on as if it had not been."""
    session, plain = Session(), Session()
    for one in (session, plain):
        one.apply({"op": "policies", "names": ["antway", "stop"]})
    told = []
    for _ in range(60):
        session.advance()
        told.append(session.frame()["views"])
    for step in (3, 59, 20, 1):
        session.apply({"op": "at", "step": step})
        frame = session.frame()
        assert (frame["at"], frame["steps"]) == (step, 60)
        for then, now in zip(told[step - 1], frame["views"], strict=True):
            for name in ("t", "robot", "speed", "braking", "obstacles", "tubes", "clearance", "at"):
                assert now[name] == then[name], name
    session.apply({"op": "step"})
    assert (session.at, session.steps) == (2, 60) and not session.ended
    session.apply({"op": "at", "step": 58})
    play(session, 12)
    play(plain, 70)
    assert session.at == session.steps == 70
    for view, other in zip(session.views, plain.views, strict=True):
        assert (view.episode.stage.xy == other.episode.stage.xy).all()
    for wrong in (-1, 2.5, None):
        with pytest.raises(BadInput):
            session.apply({"op": "at", "step": wrong})
    session.apply({"op": "at", "step": 5})
    session.apply({"op": "ants"})
    assert session.at == session.steps >= 70, "ants are shown in the cycle to come"
    session.apply({"op": "reset"})
    session.apply({"op": "at", "step": 58})  # the slider moved before the page knew that the run begins anew
    assert session.at == session.steps == 0


def test_the_ants_of_a_look_get_better() -> None:
    """With more ant cycles the best way of policy paper's ants never gets longer, and all of them give the decision taken."""
    session = Session()
    session.apply({"op": "policies", "names": ["paper"]})
    view, paths = session.views[0], []
    while not paths or view.look is not None:
        session.apply({"op": "ants"})
        if view.look is not None:
            assert view.look.decision.history is not None and view.look.decision.pheromone is not None
            paths.append(view.look.decision.history[-1, 0])
            last = view.look
    assert paths == sorted(paths, reverse=True) and last.done
    assert view.episode.decisions[-1][1].action == last.decision.action


def test_obstacles_go_round_their_waypoints() -> None:
    """Waypoints that were drawn become a round at the speed given, saved as such; too few, too fast, in walls: refused."""
    session = Session()
    points = [[5.5, 1.5], [8.5, 1.5], [8.5, 0.5]]
    session.apply({"op": "drop", "points": points, "speed": 0.5, "radius": 0.25})
    obstacle = session.scenario.world.obstacles[-1]
    assert obstacle.radius == 0.25 and obstacle.motion.points == tuple(map(tuple, points)) and obstacle.motion.speed == 0.5
    before = session.scenario
    for wrong in (
        {"points": points[:1]},
        {"points": points * 20},
        {"speed": 9.0},
        {"speed": 0.0},
        {"points": [[0.5, 3], [99, 3]]},
    ):
        with pytest.raises(BadInput):
            session.apply({"op": "drop", "points": points, "speed": 0.5, "radius": 0.25, **wrong})
    assert session.scenario is before


def test_a_link_holds_the_scenario() -> None:
    """What a link holds opens as the same scenario, and a scenario too large for an address is refused."""
    session = Session()
    session.apply({"op": "drop", "xy": [5.5, 1.5], "velocity": [0.5, 0.0], "radius": 0.3})
    link = session.apply({"op": "export", "what": "link"})[0]["hash"]
    named = dict(part.split("=", 1) for part in link.split("&"))
    assert named["policies"] == "antway" and len(link) < 8000
    data = named["open"].replace("-", "+").replace("_", "/")
    other = Session()
    other.apply({"op": "open", "files": [{"name": "link.zip", "data": data + "=" * (-len(data) % 4)}]})
    assert other.scenario.world == session.scenario.world and other.scenario.start == session.scenario.start


def test_stops_are_set_and_removed_and_their_order_follows_the_walls() -> None:
    """A press adds a stop, one on it removes it; the page is told the stops, the path over them, and what is visited."""
    session = Session()
    session.apply({"op": "policies", "names": ["follow"]})
    session.apply({"op": "open", "files": _room()})
    for xy in ([4.5, 4.5], [1.5, 4.5], [4.5, 1.5]):
        told = session.apply({"op": "stop", "xy": xy})
    (scene,) = [one for one in told if one["kind"] == "scene"]
    assert [list(at) for at in scene["stops"]] == [[4.5, 4.5], [1.5, 4.5], [4.5, 1.5]]
    before = session.frame()["views"][0]["order"]
    assert sorted(before) == [0, 1, 2]
    with pytest.raises(BadInput):
        session.apply({"op": "stop", "xy": [99.0, 1.5]})
    assert len(session.scenario.stops) == 3
    (scene,) = session.apply({"op": "paint", "runs": [[2, 1, 5]], "blocked": True})
    assert len(scene["stops"]) == 3 and len(scene["shortest"]) > 3
    play(session, 400)
    frame = session.frame()["views"][0]
    assert frame["outcome"] == "reached" and len(frame["visited"]) == 3 and frame["order"] == []
    session.apply({"op": "stop", "xy": [1.5, 4.5]})
    assert len(session.scenario.stops) == 2


def test_a_stop_joins_rounds_that_are_under_way() -> None:
    """What was driven stays, every policy drives to the stop as well, and a place out of reach changes nothing."""
    session = Session()
    session.apply({"op": "policies", "names": ["follow", "replan"]})
    session.apply({"op": "open", "files": _room()})
    session.apply({"op": "stop", "xy": [4.5, 4.5]})
    play(session, 10)
    session.frame()
    (scene,) = session.apply({"op": "stop", "xy": [1.5, 4.5]})
    assert len(scene["stops"]) == len(session.scenario.stops) == 2
    for view, told in zip(session.views, session.frame()["views"], strict=True):
        assert view.episode.steps == 10 and view.sent == 11 and sorted(told["order"]) == [0, 1]
    with pytest.raises(BadInput):
        session.apply({"op": "stop", "xy": [99.0, 1.5]})
    play(session, 400)
    for view in session.frame()["views"]:
        assert view["outcome"] == "reached" and len(view["visited"]) == 2
    session.apply({"op": "undo"})
    assert len(session.scenario.stops) == 1 and session.views[0].episode.steps == 0


def test_a_stop_joins_the_rounds_of_the_policy_that_still_drives() -> None:
    """If the other policy has arrived, what both have driven stays; once both have arrived, a stop starts the run again."""
    session = Session()
    session.apply({"op": "policies", "names": ["potential-field", "follow"]})
    session.apply({"op": "open", "files": _room()})
    session.apply({"op": "stop", "xy": [4.5, 4.5]})
    drives, arrived = session.views
    while arrived.episode.outcome is None:
        session.advance()
    assert drives.episode.outcome is None, "it takes a little longer"
    steps = session.steps
    session.apply({"op": "stop", "xy": [1.5, 4.5]})
    assert session.views == [drives, arrived] and session.steps == steps
    first, second = session.frame()["views"]
    assert second["outcome"] == "reached" and second["order"] == [] and first["order"] == [1]
    play(session, 400)
    assert len(session.frame()["views"][0]["visited"]) == 2
    session.apply({"op": "stop", "xy": [1.5, 2.5]})
    assert session.steps == 0


def _room() -> list[dict[str, str]]:
    """The files of a room of 6 x 6 m without obstacles."""
    text = "\n".join("." * 6 for _ in range(6)) + "\n"
    toml = 'map = "room.txt"\nstart = [0.5, 0.5]\ngoal = [5.5, 0.5]\n[robot]\nradius = 0.25\n'
    parts = {"room.txt": text, "room.toml": toml}
    return [{"name": name, "data": base64.b64encode(data.encode()).decode()} for name, data in parts.items()]


def test_files_in_letters_beyond_base64_are_refused_in_the_librarys_words() -> None:
    """The data of a file are base64, and what is not, ASCII or not, is named."""
    for data in ("%", "\xe9\xe9", "AAA"):
        with pytest.raises(BadInput, match=r"files\[0\]\.data"):
            decoded([{"name": "a.tsp", "data": data}])


@pytest.mark.parametrize(
    ("host", "names"),
    [("127.0.0.2", ["127.0.0.2", "127.0.0.1", "localhost"]), ("2001:DB8:0::1", ["[2001:db8::1]"]), ("Robot", ["robot"])],
)
def test_a_server_knows_the_address_that_it_prints(host: str, names: list[str]) -> None:
    """Hosts are compared as browsers send them."""
    assert {f"{name}:80" for name in names} <= names_of(host, 80)


def test_a_page_that_lacks_more_than_a_frame_holds_gets_the_rest() -> None:
    """After a stop is added, the whole driven path is sent again, in as many frames as it takes."""
    session = Session()
    session.apply({"op": "scene", "name": "rounds"})
    while session.steps < 320:
        session.advance()
        session.frame()
    assert not session.is_behind
    session.apply({"op": "stop", "xy": session.scenario.start})
    rows = 0
    while True:
        (view,) = session.frame()["views"]
        assert view["from"] == rows
        rows += len(view["trail"])
        if not session.is_behind:
            break
    assert rows == session.steps + 1


def test_a_stop_close_to_a_wall_changes_nothing_but_the_stops() -> None:
    """It may be clear of walls where the centre of its cell is not; the shortest path is drawn without its legs."""
    session = Session()
    session.apply({"op": "scene", "name": "office"})
    (scene,) = session.apply({"op": "stop", "xy": [17.395, 1.043]})
    assert scene["stops"] == [(17.395, 1.043)] and len(session.history) == 3
    for op in ("reset", "undo", "redo"):
        assert session.apply({"op": op})[0]["kind"] == "scene"


def test_start_and_goal_of_a_map_have_a_path_between_them() -> None:
    """Rooms that touch at a corner alone are two."""
    rooms = "......@@@@@@\n" * 5 + "@@@@@@......\n" * 5
    session = Session()
    session.apply({"op": "open", "files": [{"name": "rooms.txt", "data": base64.b64encode(rooms.encode()).decode()}]})
    assert session.describe()["shortest"]


def test_runs_of_cells_are_painted_and_wrong_ones_are_refused() -> None:
    """Runs (row, from, to) paint what their cells do, overlaps too; what is off the map or backwards changes nothing."""
    session = Session()
    painted = session.scenario.world.grid.blocked.copy()
    painted[18, 1:5] = painted[16, 2] = True
    session.apply({"op": "paint", "blocked": True, "runs": [[18, 1, 3], [18, 2, 4], [16, 2, 2]]})
    assert (session.scenario.world.grid.blocked == painted).all()
    session.apply({"op": "paint", "blocked": False, "runs": [[18, 2, 3]]})
    assert session.scenario.world.grid.blocked[18, 1:5].tolist() == [True, False, False, True]
    before = session.scenario
    for wrong in ([18, 3, 2], [18, 1e300, 2], [18, 1, 20], [20, 1, 2], [-1, 1, 2], [18, 1.5, 2], [18, 1], [18, 1, 1e300]):
        with pytest.raises(BadInput, match="runs"):
            session.apply({"op": "paint", "blocked": True, "runs": [wrong]})
    assert session.scenario is before


def test_two_policies_are_saved_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replay page and animation have both, and are named after both; each trace has one, and so has what is asked of a view."""
    session = Session()
    monkeypatch.setattr(Session, "work", lambda self, name, *given, seconds: {"given": given})
    session.apply({"op": "policies", "names": ["follow", "stop"]})
    for what, more, policies in (
        ("replay", {}, ("follow", "stop")), ("gif", {}, ("follow", "stop")), ("gif", {"view": 1}, ("stop",)),
        ("trace", {}, ("follow",)), ("trace", {"view": 1}, ("stop",)),
    ):  # fmt: skip
        assert session.apply({"op": "export", "what": what, **more}) == [{"given": (what, session.scenario, policies)}]
    one, two = sample_trace(20, 1), sample_trace(30, 1)
    object.__setattr__(two, "policy", "another")
    page = exported("replay", one, two)
    assert page["name"] == f"sample-{one.policy}-another.html" and '"policy":"another"' in page["text"]
    film = exported("gif", one, two)
    assert Image.open(io.BytesIO(base64.b64decode(film["base64"]))).width > 2 * 480


def _packed(files: dict[str, str]) -> list[dict[str, str]]:
    """Files as the page sends them."""
    return [{"name": name, "data": base64.b64encode(text.encode()).decode()} for name, text in files.items()]


def test_what_is_saved_opens_again_or_is_refused_when_it_is_saved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scenario that takes more bytes as a TOML file than its files opens again; where it would not, it is not saved."""
    files = {"room.txt": ("." * 40 + "\n") * 40}
    toml = 'map = "room.txt"\nstart = [1.5, 1.5]\ngoal = [38.5, 38.5]\n'
    rows = "".join(f"{k / 1000:g},{20 + k / 1000:g},20\n" for k in range(1000))
    for k in range(6):
        files[f"{k}.csv"] = rows
        toml += f'[[obstacles]]\nradius = 0.3\nmotion = "replay"\nfile = "{k}.csv"\n'
    session, sent = Session(), _packed(files | {"room.toml": toml})
    size = sum(len(text) for text in files.values()) + len(toml)
    monkeypatch.setattr("antway.web.files.MAX_BYTES", size)
    session.apply({"op": "open", "files": sent})
    for what, name in (("scenario", "base64"), ("keep", "data")):
        (saved,) = session.apply({"op": "export", "what": what})
        unpacked = zipfile.ZipFile(io.BytesIO(base64.b64decode(saved[name])))
        assert sum(entry.file_size for entry in unpacked.infolist()) > size
        session.apply({"op": "open", "files": [{"name": "scenario.zip", "data": saved[name]}]})
    for limit in ("MAX_UNPACKED", "MAX_BYTES"):
        with monkeypatch.context() as smaller:
            smaller.setattr(f"antway.web.files.{limit}", 1000)
            for what in ("scenario", "keep", "link"):
                with pytest.raises(TooLarge, match=r"scenario = '[0-9]+ bytes': must be at most 1000"):
                    session.apply({"op": "export", "what": what})


def test_archives_together_unpack_to_no_more_than_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each may be below the limit and small; nothing above it is unpacked."""
    monkeypatch.setattr("antway.web.files.MAX_UNPACKED", 100_000)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.txt", "." * 60_000)
    data = base64.b64encode(buffer.getvalue()).decode()
    with pytest.raises(TooLarge, match="files = '120000 bytes'"):
        read_upload([{"name": f"{k}.zip", "data": data} for k in range(2)])


def test_a_stop_that_joins_rounds_ends_a_look_at_the_ants() -> None:
    """The ants looked at were those of rounds without the stop; the page is told no more of them."""
    session = Session()
    session.apply({"op": "policies", "names": ["antway"]})
    session.apply({"op": "open", "files": _room()})
    session.apply({"op": "stop", "xy": [4.5, 4.5]})
    session.apply({"op": "step"})
    (view,) = session.views
    view.look, view.idle = Look(2, False, Decision("avoid", "Seen in a look."), view.policy), "Nothing to do."
    assert session.frame()["views"][0]["ants"] == [2, False]
    session.apply({"op": "stop", "xy": [1.5, 4.5]})
    (told,) = session.frame()["views"]
    assert told["ants"] is None and told["idle"] == "" and told["decision"]["reason"] != "Seen in a look."


def test_the_radius_of_a_robot_with_a_footprint_is_refused() -> None:
    """It follows from the footprint; the refusal says so, and is no step of undo."""
    session, (room, _) = Session(), _room()
    toml = 'map = "room.txt"\nstart = [1.5, 1.5]\ngoal = [4.5, 1.5]\n[robot]\ndrive = "differential"\n'
    toml += "footprint = [[-0.4, -0.3], [0.4, -0.3], [0.4, 0.3], [-0.4, 0.3]]\n"
    session.apply({"op": "open", "files": [room, *_packed({"room.toml": toml})]})
    before = session.scenario
    with pytest.raises(BadInput, match=r"robot\.radius = 0\.3: must be left as it is: this robot's footprint gives its radius"):
        session.apply({"op": "set", "field": "robot.radius", "value": 0.3})
    assert session.scenario is before


def test_a_seed_that_the_pages_numbers_do_not_hold_is_told_to_the_last_digit() -> None:
    """A file may have a seed above 2^53, which a script's number would round."""
    session, (room, toml) = Session(), _room()
    text = "seed = 12345678901234567891\n" + base64.b64decode(toml["data"]).decode()
    (scene,) = session.apply({"op": "open", "files": [room, *_packed({"room.toml": text})]})
    assert scene["parameters"]["seed"] == "12345678901234567891"


def test_a_long_control_period_delays_no_other_scene() -> None:
    """After a scene with control cycles of a minute was played, the next one opened in the tab plays at once."""
    sent: list[dict[str, Any]] = []
    passed: list[dict[str, Any]] = []  # what was sent until the last time that something was waited for

    class Wire:
        application_state = WebSocketState.CONNECTED

        def __init__(self) -> None:
            self.queue: asyncio.Queue[dict[str, Any]] = asyncio.Queue()

        async def receive(self) -> dict[str, Any]:
            return await self.queue.get()

        async def send_text(self, text: str) -> None:
            sent.append(json.loads(text))
            if sent[-1]["kind"] == "frame":
                self.ask(op="seen")

        async def close(self, code: int) -> None:
            self.queue.put_nowait({"type": "websocket.disconnect"})

        def ask(self, **request: Any) -> None:
            self.queue.put_nowait({"type": "websocket.receive", "text": json.dumps(request)})

    async def until(holds: Any) -> None:
        async with asyncio.timeout(120.0):  # kernels may be compiled meanwhile
            while not any(holds(message) for message in sent[len(passed) :]):
                await asyncio.sleep(0.01)
        passed.extend(sent[len(passed) :])

    async def use() -> None:
        wire, session = Wire(), Session()
        session.apply({"op": "policies", "names": ["follow"]})
        session._open(replace(session.scenario, robot=replace(session.scenario.robot, dt=60.0), horizon=10_000.0))
        task = asyncio.create_task(Player(wire, session, Turns(), Turns(1)).run())  # type: ignore[arg-type]
        wire.ask(op="play", on=True)
        await until(lambda last: last["kind"] == "frame" and last["playing"])
        wire.ask(op="scene", name="paper")
        wire.ask(op="play", on=True)
        await until(lambda last: last["kind"] == "frame" and last["steps"] > 2)
        session.playing = False
        await asyncio.sleep(0.3)
        session._open(replace(session.scenario, robot=replace(session.scenario.robot, dt=60.0), horizon=10_000.0))
        wire.ask(op="play", on=True)
        await until(lambda last: last["kind"] == "frame" and last["playing"] and last["steps"] == 0)
        await asyncio.sleep(0.2)
        assert sent[-1]["steps"] == 0, "confirmations of frames do not make play faster"
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(use())
