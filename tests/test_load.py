"""C40: many pages, requests and clients that misbehave at once; the server stays small, quick and right."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import gc
import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from antway.web import player
from antway.web.player import LULL, Turns
from antway.web.session import Session
from common import cases
from serving import TOKEN, compile_all, served, serving

PAGES, REQUESTS, SLOW, LORIS, JUNK = cases(12, 200), cases(60, 1000), cases(2, 20), cases(10, 200), cases(100, 10_000)
STEPS = 20
pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads the size of a process from /proc")


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[int, int, str]]:
    """Port, process and token of `antway serve`."""
    compile_all()
    command = [sys.executable, "-c", "from antway.cli import main; main()", "serve", "--no-browser", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        printed = re.search(r":(\d+)/\?token=(\S+)", process.stdout.readline())
        assert printed is not None
        yield int(printed[1]), process.pid, printed[2]
        process.terminate()


def size(pid: int) -> float:
    """Resident memory, MiB."""
    text = Path(f"/proc/{pid}/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+)", text)[1]) / 1024  # type: ignore[index]


async def close(writer: asyncio.StreamWriter) -> None:
    writer.close()
    with contextlib.suppress(ConnectionError):
        await writer.wait_closed()


async def ask(port: int, times: list[float]) -> bytes:
    """Get the page's script over a connection of its own."""
    started = time.perf_counter()
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET /page.js HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n".encode())
    answer = await reader.read()
    while not reader.at_eof():
        answer += await reader.read()
    await close(writer)
    times.append(time.perf_counter() - started)
    return answer[9:12]


def live(port: int, token: str, **options: Any) -> Any:
    own = f"127.0.0.1:{port}"
    return connect(f"ws://{own}/live", origin=f"http://{own}", subprotocols=["antway", token], **options)  # type: ignore[arg-type, list-item]


async def frame(wire: ClientConnection) -> dict[str, Any]:
    """The next frame, confirmed."""
    while True:
        message = json.loads(await asyncio.wait_for(wire.recv(), 60))
        if message["kind"] == "frame":
            await wire.send('{"op":"seen"}')
            return message


async def steps(wire: ClientConnection) -> list[Any]:
    """Where the robot is after each of the first `STEPS` cycles."""
    await wire.send('{"op":"reset"}')
    while (await frame(wire))["views"][0]["t"] > 0.0:
        pass
    places = []
    for step in range(1, STEPS + 1):
        await wire.send('{"op":"step"}')
        while (view := (await frame(wire))["views"][0])["t"] < 0.1 * step - 0.05:
            pass
        places.append(view["robot"])
    return places


async def page(port: int, token: str, ready: asyncio.Event, stop: asyncio.Event) -> list[Any]:
    """Play a run as a page does, and from the start again one step after the other; return where these led."""
    async with live(port, token) as wire:
        await frame(wire)
        ready.set()
        await wire.send('{"op":"play","on":true}')
        now = await frame(wire)
        while not stop.is_set():
            now = await frame(wire)
            if now["views"][0]["outcome"]:
                await wire.send('{"op":"reset"}')
                await wire.send('{"op":"play","on":true}')
        return await steps(wire)


async def slow(port: int, token: str, stop: asyncio.Event) -> float:
    """Play and read, but never confirm a frame; return how many seconds after the first one the server hangs up, if it does."""
    async with live(port, token) as wire:
        await wire.send('{"op":"speed","speed":8}')
        await wire.send('{"op":"play","on":true}')
        while '"kind":"frame"' not in await wire.recv():
            pass
        started = time.perf_counter()
        with contextlib.suppress(ConnectionClosed):
            while not stop.is_set():
                await wire.recv()
        return time.perf_counter() - started


async def junk(port: int, token: str, messages: list[str | bytes], timeout: float) -> int | None:
    """Send junk; return the code with which the server hung up, None if it did not."""
    async with live(port, token) as wire:
        with contextlib.suppress(ConnectionClosed, ConnectionError):
            for message in messages:
                await wire.send(message)
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(wire.wait_closed(), timeout)
        return wire.close_code


def requests(rng: np.random.Generator, n: int) -> list[str | bytes]:
    """Messages that ask for nothing sensible."""
    texts: list[str | bytes] = ["{", "[]", "null", '{"op":"step","x":' + "[" * 3000, "1e999", '{"op":"drop"}', "\u0000"]
    texts += [
        '{"op":"open","files":[{"name":"a.zip","data":"UEsDBA=="}]}',
        '{"op":"set","field":"seed","value":1e400}',
        "NaN",
        '{"op":"play","on":1}',
    ]
    return [texts[int(k)] for k in rng.integers(len(texts), size=n)]


def test_the_server_bears_a_crowd(server: tuple[int, int, str]) -> None:
    """Pages and requests are answered without error while others dawdle, drip, flood and upload; memory stays bounded."""
    port, pid, token = server

    async def crowd() -> None:
        times: list[float] = []
        async with live(port, token) as wire:
            await frame(wire)
            alone = await steps(wire)
        before = size(pid)
        gc.collect()
        gc.freeze()  # else this process, full of tests, looks for its own garbage while it takes the server's times

        drips = [await asyncio.open_connection("127.0.0.1", port) for _ in range(LORIS)]
        for _, drip in drips:
            drip.write(b"GET / HTTP/1.1\r\nHost: 127")
        stop, ready = asyncio.Event(), [asyncio.Event() for _ in range(PAGES - SLOW)]
        pages = [asyncio.create_task(page(port, token, event, stop)) for event in ready]
        await asyncio.gather(*(asyncio.wait_for(event.wait(), 120) for event in ready))
        dawdlers = [asyncio.create_task(slow(port, token, stop)) for _ in range(SLOW)]

        statuses = await asyncio.gather(*(ask(port, times) for _ in range(REQUESTS)))
        assert set(statuses) == {b"200"}, f"{len(statuses)} answers"
        rng = np.random.default_rng(0)
        floods = await asyncio.gather(*(junk(port, token, requests(rng, JUNK), 30.0 if JUNK > 1000 else 0.1) for _ in range(2)))
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        head, printed = f"POST / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 10000000\r\n\r\n", b""
        with contextlib.suppress(ConnectionError):  # the server may hang up before all is sent
            writer.write(head.encode() + bytes(10_000_000))
            await writer.drain()
            printed = await reader.read(12)
        assert printed[9:] in (b"405", b"")
        await close(writer)
        assert await junk(port, token, ["x" * 7_000_000], 30.0) == 1009
        grown = size(pid) - before

        cut = await asyncio.gather(*dawdlers) if PAGES >= 200 else [0.0]
        stop.set()
        ends = await asyncio.gather(*pages)
        for _, drip in drips:
            await close(drip)
        p99 = float(np.percentile(times, 99))
        print(f"C40: {PAGES} pages, {REQUESTS} requests: p99 {1e3 * p99:.0f} ms, RSS {before:.0f} + {grown:.0f} MiB; "
              f"slow clients cut after {max(cut):.1f} s; floods of {JUNK} messages ended with {floods}")  # fmt: skip
        assert grown <= 100.0
        assert set(floods) <= {1008, None}, "ended, or held back by being read no faster than answered"
        if PAGES >= 200:
            assert max(cut) <= 10.0, "a page that takes nothing is cut"
        assert all(end == alone for end in ends), "a run in a crowd is the run alone"

    try:
        asyncio.run(crowd())
    finally:
        gc.unfreeze()
    with socket.create_connection(("127.0.0.1", port)) as wire:  # and it still answers
        wire.sendall(f"GET /page.js HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n".encode())
        assert wire.recv(12)[9:] == b"200"


def test_who_says_nothing_or_too_much_is_hung_up_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Requests that do not end or grow too long, a page that confirms nothing, and a flood are ended within their time."""
    from antway.web import server

    monkeypatch.setattr(player, "TIMEOUT", 1.5)
    monkeypatch.setattr(server, "TIMEOUT", 0.5)
    with served() as port:
        with socket.create_connection(("127.0.0.1", port), timeout=10) as wire:
            wire.sendall(b"GET / HTTP/1.1\r\nHost:")
            assert wire.recv(100) == b""
        with socket.create_connection(("127.0.0.1", port), timeout=10) as wire, contextlib.suppress(ConnectionError):
            for _ in range(100):
                wire.sendall(b"GET / HTTP/1.1\r\n" + b"X: " + bytes(64).hex().encode() * 100)
            assert wire.recv(100) in (b"", b"HTTP/1.1 400 Bad Request")

        async def dawdle() -> None:
            async with live(port, TOKEN) as wire:
                with pytest.raises(ConnectionClosed):
                    for _ in range(20):
                        await asyncio.wait_for(wire.recv(), 10)

        asyncio.run(dawdle())
        assert asyncio.run(junk(port, TOKEN, ['{"op":"seen"}'] * 1000, 20.0)) == 1008


def cut_after(wire: socket.socket, drip: bytes) -> float:
    """Send a byte of `drip` ten times a second; returns after how many seconds the server has hung up."""
    started = time.perf_counter()
    wire.setblocking(False)
    while time.perf_counter() - started < 20.0:
        for byte in drip:
            try:
                wire.sendall(bytes([byte]))
                if wire.recv(4096) == b"":
                    return time.perf_counter() - started
            except BlockingIOError:
                pass
            except ConnectionError:
                return time.perf_counter() - started
            time.sleep(0.1)
    raise AssertionError("never cut")


def test_a_request_that_drips_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    """D12: after a complete request, in the body of one, between two, and at the begin: a byte now and then keeps nobody in."""
    from antway.web import server

    monkeypatch.setattr(server, "TIMEOUT", 0.5)
    with served() as port:
        head = f"Host: 127.0.0.1:{port}\r\n"
        whole = f"GET /page.js HTTP/1.1\r\n{head}\r\n".encode()
        for first, drip in (
            (b"", b"GET / HTTP/1.1\r\nX: " + b"y" * 200),
            (whole, b"GET / HTTP/1.1\r\nX: " + b"y" * 200),
            (whole, b"\r\n" * 100),
            (f"POST / HTTP/1.1\r\n{head}Content-Length: 100000\r\n\r\n".encode(), b"z" * 200),
            (whole + b"GET / HTTP/1.1\r\n", b"X: " + b"y" * 200),
        ):
            with socket.create_connection(("127.0.0.1", port), timeout=10) as wire:
                wire.sendall(first)
                if first.startswith(b"GET"):
                    assert wire.recv(12)[9:] == b"200"
                assert cut_after(wire, drip) < 0.5 + 3.0, (first, drip[:10])
        with socket.create_connection(("127.0.0.1", port), timeout=10) as wire:  # and who is quick is served again and again
            for _ in range(300):
                wire.sendall(whole)
                answer = wire.recv(65536)
                size = int(re.search(rb"content-length: (\d+)", answer)[1])  # type: ignore[index]
                body = len(answer) - answer.index(b"\r\n\r\n") - 4
                while body < size:
                    body += len(wire.recv(65536))


def test_a_page_that_never_answers_close_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    """D12: a websocket that was closed for what it sent is cut soon after, whatever it does not answer."""
    from antway.web import server

    monkeypatch.setattr(server, "CLOSING", 0.5)
    with served() as port, socket.create_connection(("127.0.0.1", port), timeout=10) as wire:
        own, key = f"127.0.0.1:{port}", base64.b64encode(bytes(16)).decode()
        head = f"GET /live HTTP/1.1\r\nHost: {own}\r\nOrigin: http://{own}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        head += f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Protocol: antway, {TOKEN}\r\n\r\n"
        wire.sendall(head.encode())
        assert wire.recv(12) == b"HTTP/1.1 101"
        wire.sendall(bytes([0x82, 0x81, 0, 0, 0, 0, 7]))  # bytes, where text is spoken: the server closes
        assert cut_after(wire, bytes([0x8A, 0x80, 0, 0, 0, 0])) < 8.0  # it sends pongs for ever


def test_what_is_sent_after_uvicorn_has_hung_up_is_dropped() -> None:
    """A page breaks the websocket's protocol while a frame is on its way: the frame meets a page that has left, no error."""
    met: list[Exception] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "websocket":
            return
        await receive()
        await send({"type": "websocket.accept"})
        assert (await receive())["type"] == "websocket.disconnect"
        try:
            await send({"type": "websocket.send", "text": "late"})
        except Exception as error:
            met.append(error)

    with serving(lambda port: app) as port, socket.create_connection(("127.0.0.1", port), timeout=10) as wire:
        key = base64.b64encode(bytes(16)).decode()
        head = "GET / HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        wire.sendall(f"{head}Sec-WebSocket-Key: {key}\r\n\r\n".encode())
        assert wire.recv(12) == b"HTTP/1.1 101"
        wire.sendall(b"\xff\xff")  # no frame
        while wire.recv(4096):
            pass
    assert [isinstance(error, OSError) for error in met] == [True], met  # Starlette takes an OSError as a page that has left


def test_who_does_not_read_is_hung_up_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page that asks for files and reads none of them is cut, and its session ends, once no more can be sent to it."""
    from antway.web import server

    sessions: list[Session] = []

    class Known(Session):
        def __init__(self) -> None:
            super().__init__()
            sessions.append(self)

    monkeypatch.setattr(player, "TIMEOUT", 600.0)  # so that it is not cut for what it leaves unconfirmed
    monkeypatch.setattr(server, "TIMEOUT", 0.2)
    monkeypatch.setattr(server, "Session", Known)
    with served() as port, socket.socket() as wire:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        wire.connect(("127.0.0.1", port))
        own, key = f"127.0.0.1:{port}", base64.b64encode(bytes(16)).decode()
        head = f"GET /live HTTP/1.1\r\nHost: {own}\r\nOrigin: http://{own}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        head += f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Protocol: antway, {TOKEN}\r\n\r\n"
        request = b'{"op":"export","what":"replay"}'
        masked = bytes([0x81, 0x80 | len(request), 0, 0, 0, 0]) + request  # with zeros
        wire.sendall(head.encode())
        assert wire.recv(12) == b"HTTP/1.1 101"
        wire.sendall(200 * masked)  # many more than the system keeps for a connection
        while not sessions:
            time.sleep(0.01)
        assert sessions[0].closed.wait(100)


def test_requests_go_first_and_hold_up_play_for_a_moment_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """At most two work at once, first come first served; a request delays play, a stream of them for no longer than HOLD."""
    monkeypatch.setattr(player, "HOLD", 0.2)

    async def check() -> None:
        turns, at_once, most, order = Turns(), 0, 0, []
        lock = threading.Lock()

        def work(k: int) -> None:
            nonlocal at_once, most
            with lock:
                at_once += 1
                most = max(most, at_once)
                order.append(k)
            time.sleep(0.01)
            with lock:
                at_once -= 1

        await asyncio.gather(*(turns.take(work, k) for k in range(8)))
        assert most == 2 and sorted(order) == list(range(8)) and {0, 1} == set(order[:2])
        clock = asyncio.get_running_loop().time
        turns.request()
        async with turns.lull():
            assert clock() - turns.latest_request >= LULL

        async def play() -> None:
            async with turns.lull():
                pass

        started = clock()
        held = [asyncio.create_task(play()) for _ in range(20)]
        while not all(task.done() for task in held):
            turns.request()
            await asyncio.sleep(0)
        assert 0.2 <= clock() - started < 20 * 0.2

    asyncio.run(check())


def test_few_wait_for_a_thread_to_play_when_requests_come() -> None:
    """Of a hundred tabs that play two are past the look for a lull, so that a request finds two at work and none queued."""

    async def check() -> None:
        turns, past, most = Turns(), 0, 0

        async def play() -> None:
            nonlocal past, most
            async with turns.lull():
                past += 1
                most = max(most, past)
                await turns.take(time.sleep, 0.001)
                past -= 1

        await asyncio.gather(*(play() for _ in range(100)))
        assert most == player.THREADS

    asyncio.run(check())


def test_requests_are_done_while_play_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """While requests hold up play for as long as the test lasts, a step, an edit and a pause are answered all the same."""
    monkeypatch.setattr(player, "LULL", 600.0)
    monkeypatch.setattr(player, "HOLD", 600.0)
    with served() as port:

        async def check() -> None:
            async with live(port, TOKEN) as wire:
                await frame(wire)
                await wire.send('{"op":"play","on":true}')
                assert (now := await frame(wire))["playing"] and now["views"][0]["t"] == 0.0
                await wire.send('{"op":"play","on":false}')
                assert not (now := await frame(wire))["playing"] and now["views"][0]["t"] == 0.0
                await wire.send('{"op":"play","on":true}')
                assert (await frame(wire))["playing"]
                await wire.send('{"op":"set","field":"seed","value":7}')
                while (message := json.loads(await asyncio.wait_for(wire.recv(), 60)))["kind"] != "scene":
                    pass
                assert message["parameters"]["seed"] == "7"
                await steps(wire)

        asyncio.run(check())


def test_nobody_waits_for_what_others_export(monkeypatch: pytest.MonkeyPatch) -> None:
    """While as many tabs as there are threads write files, another tab opens and steps; then they get their files."""
    from antway.web import server

    done = threading.Event()

    class Slow(Session):
        def _export(self, message: dict[str, Any]) -> list[dict[str, Any]]:
            assert done.wait(60)
            return super()._export(message)

    monkeypatch.setattr(server, "Session", Slow)
    with served() as port:

        async def check() -> None:
            async with live(port, TOKEN) as one, live(port, TOKEN) as two:
                for wire in (one, two):
                    await frame(wire)
                    await wire.send('{"op":"export","what":"link"}')
                async with live(port, TOKEN) as wire:
                    await steps(wire)
                done.set()
                for wire in (one, two):
                    while json.loads(await asyncio.wait_for(wire.recv(), 60))["kind"] != "link":
                        pass

        asyncio.run(check())


def test_two_tabs_of_a_million_steps_a_second_keep_no_third_waiting() -> None:
    """D11: two tabs play with a control period of 1e-6 s; a third opens, edits and steps meanwhile, which once took 21 s."""
    room = "map = 'm.txt'\nstart = [1.5, 1.5]\ngoal = [8.5, 8.5]\nhorizon = 0.9\n[robot]\ndt = 1e-6\n"
    cells = ("." * 10 + "\n") * 10
    files = [
        {"name": name, "data": base64.b64encode(text.encode()).decode()} for name, text in (("s.toml", room), ("m.txt", cells))
    ]
    with served() as port:

        async def check() -> None:
            async with live(port, TOKEN) as one, live(port, TOKEN) as two:
                stop = asyncio.Event()

                async def play(wire: ClientConnection) -> int:
                    await frame(wire)
                    await wire.send(json.dumps({"op": "open", "files": files}))
                    while json.loads(await asyncio.wait_for(wire.recv(), 60))["kind"] != "scene":
                        pass
                    await wire.send('{"op":"play","on":true}')
                    now = await frame(wire)
                    ready.release()
                    while not stop.is_set():
                        now = await frame(wire)
                    return int(now["views"][0]["at"])

                ready = asyncio.Semaphore(0)
                busy = [asyncio.create_task(play(wire)) for wire in (one, two)]
                for _ in busy:
                    await ready.acquire()
                times = []
                async with live(port, TOKEN) as wire:
                    await frame(wire)
                    for step in range(1, 11):
                        started = time.perf_counter()
                        await wire.send('{"op":"step"}')
                        while (await frame(wire))["views"][0]["t"] < 0.1 * step - 0.05:
                            pass
                        times.append(time.perf_counter() - started)
                stop.set()
                played = await asyncio.gather(*busy)
                assert min(played) > 0, "they play on"
                assert max(times) < 40 * player.SLICE, times

        asyncio.run(check())


def test_no_more_tabs_open_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of twelve tabs that open at the same moment, as many get a session as there are, and a place that is left is given on."""
    from antway.web import server

    monkeypatch.setattr(server, "MAX_SESSIONS", 3)
    with served() as port:

        async def storm() -> None:
            opened = await asyncio.gather(*(live(port, TOKEN) for _ in range(12)), return_exceptions=True)
            wires = [wire for wire in opened if not isinstance(wire, BaseException)]
            assert len(wires) == 3
            for wire in wires:
                await frame(wire)
                await wire.close()
            async with live(port, TOKEN) as wire:
                await frame(wire)

        asyncio.run(storm())


def test_the_page_is_opened_in_the_browser_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    """`antway serve` says where it is and opens that address in the browser that the system names."""
    monkeypatch.setenv("BROWSER", "echo opened %s")
    command = [sys.executable, "-c", "from antway.cli import main; main()", "serve", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            printed = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", process.stdout.readline())
            assert printed is not None and process.stdout.readline() == f"opened {printed[0]}\n"
        finally:
            process.terminate()


def test_an_interrupt_ends_the_server_quietly() -> None:
    """Ctrl-C ends `antway serve` while a page plays, without a word on the error stream."""
    command = [sys.executable, "-c", "from antway.cli import main; main()", "serve", "--no-browser", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        printed = re.search(r":(\d+)/\?token=(\S+)", process.stdout.readline())
        assert printed is not None
        port, token = int(printed[1]), printed[2]

        async def leave() -> None:
            async with live(port, token) as wire:
                await frame(wire)
                await wire.send('{"op":"play","on":true}')
                await frame(wire)
                process.send_signal(signal.SIGINT)
                with contextlib.suppress(ConnectionClosed):
                    while True:
                        await frame(wire)

        asyncio.run(leave())
        _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, "")
