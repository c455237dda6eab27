"""Every control of the pages in a real browser: choosers, keys, parameters, pan and zoom, what is saved and opened again."""

from __future__ import annotations

import base64
import io
import re
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from antway import load_scenario
from antway.scenes import SCENES
from antway.view.replay import write_replay
from antway.web.session import PARAMETERS, Session
from antway.web.tours import INSTANCES
from browser import DESKTOP, chromium, dead, drag, drawn, drop, expect, needs_browser, opened, pixels, point, saved
from sample import sample_trace
from serving import served

pytestmark = needs_browser
SQUARE = "NAME : square\nTYPE : TSP\nDIMENSION : 4\nEDGE_WEIGHT_TYPE : EUC_2D\nNODE_COORD_SECTION\n"
SQUARE += "1 0 0\n2 0 10\n3 10 10\n4 10 0\nEOF\n"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as one, served() as port:
        yield one, f"http://127.0.0.1:{port}/"


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    yield from quiet(browser, "")


@pytest.fixture
def tours(browser: Any) -> Iterator[Any]:
    yield from quiet(browser, "tsp")


def quiet(browser: Any, path: str) -> Iterator[Any]:
    """A page on a desktop that at its end has said nothing in the console and asked nobody else for anything."""
    page, complaints = opened(browser[0], browser[1] + path, (browser[1], "blob:", "data:"), **DESKTOP)
    yield page
    page.context.close()
    assert complaints == []


def picture(page: Any, canvas: str = "canvas.stage") -> bytes:
    drawn(page)
    return base64.b64decode(page.evaluate(f"document.querySelector('{canvas}').toDataURL()").split(",")[1])


@pytest.mark.parametrize("path", ["", "tsp"])
def test_no_control_is_dead(browser: Any, path: str) -> None:
    """Each button, chooser and field of the live pages is listened to, of both policies where two are compared."""
    page, complaints = opened(browser[0], browser[1] + path, (browser[1], "data:"), **DESKTOP)
    if not path:
        page.click("#compare")
        expect(page, ".view").to_have_count(2)
    assert dead(page) == [] and complaints == []
    page.evaluate("() => document.body.append(document.createElement('button'))")
    assert dead(page) == ["button"], "what is dead is found"
    page.context.close()


def test_no_control_of_a_replay_is_dead(browser: Any, tmp_path: Path) -> None:
    """Each button, chooser and field of a replay page, of one episode or of two, is listened to."""
    for beside in ([], [sample_trace(40, 2)]):
        file = write_replay(sample_trace(60, 2), tmp_path / "r.html", beside=beside)
        page, complaints = opened(browser[0], file.as_uri(), ("file:", "data:"), **DESKTOP)
        assert dead(page) == [] and complaints == []
        page.context.close()


def test_every_scene_can_be_chosen(page: Any) -> None:
    """The chooser opens each scene that comes with the package, which steps on."""
    for name in (*SCENES[1:], SCENES[0]):
        page.select_option("#scene", name)
        expect(page, "#scene").to_have_value(name)
        page.wait_for_selector(f"body[data-ready=true] #scene option:checked:text-is('{name}')", state="attached")
        expect(page, "#time").to_have_text("0.0 s")
        page.click("#step")
        expect(page, "#time").not_to_have_text("0.0 s")


def test_a_ros_map_is_opened_with_its_picture(page: Any, tmp_path: Path) -> None:
    """A yaml and the picture that it names open as a map with its resolution; without the picture it is refused."""
    Image.fromarray(np.pad(np.full((20, 30), 254, np.uint8), 1)).save(tmp_path / "hall.pgm")
    (tmp_path / "hall.yaml").write_text(
        "image: hall.pgm\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    page.set_input_files("#files", tmp_path / "hall.yaml")
    expect(page, "#notice").to_contain_text("hall.yaml is the description of a map: choose its picture too")
    page.set_input_files("#files", [tmp_path / "hall.yaml", tmp_path / "hall.pgm"])
    expect(page, "#scene option:checked").to_have_text("hall")
    expect(page, "#notice").to_be_hidden()
    zipfile.ZipFile(io.BytesIO(saved(page, "scenario")[1])).extractall(tmp_path / "out")
    grid = load_scenario(tmp_path / "out" / "scenario.toml").world.grid
    assert grid.shape == (22, 32) and grid.resolution == 0.5


def test_the_brush_the_start_and_obstacles(page: Any, tmp_path: Path) -> None:
    """A wide brush paints a block, the start is dragged, an obstacle of a radius is dropped and erased, keys undo and redo."""
    page.keyboard.press("w")
    page.select_option("#brush", "3")
    page.mouse.click(*point(page, 5.5, 1.5))
    expect(page, "#undo").to_be_enabled()
    page.keyboard.press("o")
    page.fill("#size", "9")
    page.keyboard.press("Tab")
    expect(page, "#notice").to_contain_text("must be from 0.05 to 5")
    page.fill("#size", "0.7")
    page.keyboard.press("Tab")
    page.keyboard.press("v")
    drag(page, (0.5, 0.5), (1.5, 3.5))
    page.keyboard.press("o")
    page.mouse.click(*point(page, 8.5, 18.5))

    def world() -> Any:
        zipfile.ZipFile(io.BytesIO(saved(page, "scenario")[1])).extractall(tmp_path)
        return load_scenario(tmp_path / "scenario.toml")

    now = world()
    assert now.world.grid.blocked[0:3, 4:7].all()
    assert np.abs(np.array(now.start) - (1.5, 3.5)).max() < 0.2
    assert now.world.obstacles[-1].radius == 0.7
    many = len(now.world.obstacles)
    page.keyboard.press("e")
    page.mouse.click(*point(page, 8.5, 18.5))
    assert len(world().world.obstacles) == many - 1
    page.keyboard.press("Control+z")
    assert len(world().world.obstacles) == many
    page.keyboard.press("Control+Shift+z")
    expect(page, "#redo").to_be_disabled()
    assert len(world().world.obstacles) == many - 1


def test_keys_zoom_and_colours(page: Any) -> None:
    """R goes back, + and - change the speed, C compares, T changes the colours, the wheel zooms, a drag pans, F shows all."""
    page.keyboard.press("ArrowRight")
    expect(page, "#time").to_have_text("0.1 s")
    page.keyboard.press("r")
    expect(page, "#time").to_have_text("0.0 s")
    for key, speed in (("+", "2"), ("-", "1"), ("-", "0.5")):
        page.keyboard.press(key)
        expect(page, "#speed").to_have_value(speed)
    theme = page.evaluate("document.documentElement.dataset.theme")
    page.keyboard.press("t")
    assert page.evaluate("document.documentElement.dataset.theme") != theme
    page.click("#theme")
    assert page.evaluate("document.documentElement.dataset.theme") == theme
    whole = picture(page)
    page.mouse.move(*point(page, 10, 10))
    page.mouse.wheel(0, -600)
    near = picture(page)
    assert near != whole
    box = page.locator("canvas.stage").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + 60, middle[1] + 40, steps=4)
    page.mouse.up()
    assert picture(page) not in (near, whole)
    page.keyboard.press("f")
    assert picture(page) == whole
    page.keyboard.press("c")
    expect(page, ".view").to_have_count(2)
    page.click("#compare")
    expect(page, ".view").to_have_count(1)
    page.click(".menu summary")
    page.keyboard.press("Escape")
    expect(page, "#save-png").to_be_hidden()
    page.click("aside details:last-of-type summary")
    expect(page, "kbd >> nth=0").to_be_visible()


def test_the_panel_tells_of_cycles(page: Any) -> None:
    """After some cycles the panel shows their times as bars, the way driven, and how near obstacles came."""
    expect(page, ".reason").to_contain_text("Press play")
    for step in range(1, 6):
        page.click("#step")
        expect(page, "#time").to_have_text(f"{step / 10:.1f} s")
    expect(page, ".cycle span").to_have_text(re.compile(r"^cycle [\d.]+ ms, worst of \d+: [\d.]+ ms$"))
    assert pixels(page, "robot", ".spark") > 20
    expect(page, ".numbers").to_have_text(re.compile(r"^0\.5 s · 0\.\d m driven · \d\.\d\d m/s · nearest \d\.\d\d m$"))
    expect(page, ".facts").to_contain_text("Certified gap")


def test_every_parameter_is_kept_or_refused_in_place(page: Any) -> None:
    """Each parameter has a name, unit, range and meaning; a value within its range is taken, one outside refused beside it."""
    page.click("details:has(#parameters) > summary")
    scenario = Session().scenario
    for p in PARAMETERS:
        row = page.locator(f"#parameters label:has([id='parameter-{p.field}'])")
        text = row.inner_text()
        assert p.label in text and p.meaning in text and p.unit in text and f"{p.low:g}" in text
        value = scenario
        for part in p.field.split("."):
            value = getattr(value, part)
        step = 1 if p.field == "seed" else 0.05
        changed = f"{float(value) + step:g}"  # type: ignore[arg-type]
        row.locator("input").fill(f"{p.high + step:.16g}")
        page.keyboard.press("Tab")
        expect(page, f"[id='wrong-{p.field}']").to_contain_text(p.field)
        row.locator("input").fill(changed)
        page.keyboard.press("Tab")
        expect(page, f"[id='wrong-{p.field}']").to_have_text("")
        expect(page, f"[id='parameter-{p.field}']").to_have_js_property("value", changed)
    for _ in PARAMETERS:
        expect(page, "#undo").to_be_enabled()
        page.click("#undo")
    expect(page, "#undo").to_be_disabled()


def test_a_link_can_be_copied(browser: Any) -> None:
    """The dialog shows the link, Copy puts it on the clipboard, Close and Escape close it."""
    page, complaints = opened(
        browser[0], browser[1], (browser[1], "data:"), permissions=["clipboard-read", "clipboard-write"], **DESKTOP
    )
    for leave in (lambda: page.click("#close-link"), lambda: page.keyboard.press("Escape")):
        page.click(".menu summary")
        page.click("#save-link")
        expect(page, "#link-box").to_be_visible()
        page.click("#copy")
        expect(page, "#copy").to_have_text("Copied")
        assert page.evaluate("navigator.clipboard.readText()") == page.locator("#link").input_value()
        leave()
        expect(page, "#link-box").to_be_hidden()
    assert complaints == []
    page.context.close()


def test_tours_are_chosen_set_and_saved(tours: Any) -> None:
    """Each set of cities, rule, persistence and search can be chosen; keys, layers and files do what they say."""
    page = tours
    for name in INSTANCES:
        page.select_option("#instance", name)
        expect(page, "#map").to_have_attribute("aria-label", re.compile(rf"^{INSTANCES[name]().size} cities"))
    for field in ("rule", "persistence", "search"):
        for value in page.locator(f"#set-{field} option").all_inner_texts():
            page.select_option(f"#set-{field}", value)
            expect(page, "#cycle").to_have_text("0")
            page.keyboard.press("Escape")
            page.locator("h1").click()
            page.keyboard.press("ArrowRight")
            expect(page, "#cycle").to_have_text("1")
    page.fill("#set-seed", "5")
    page.keyboard.press("Tab")
    expect(page, "#cycle").to_have_text("0")
    page.fill("#set-seed", "-1")
    page.keyboard.press("Tab")
    expect(page, "#settings .wrong >> nth=4").to_contain_text("seed = -1")
    page.locator("h1").click()
    page.keyboard.press("+")
    expect(page, "#speed").to_have_value("64")
    page.keyboard.press("-")
    expect(page, "#speed").to_have_value("16")
    page.click("#step")
    expect(page, "#cycle").to_have_text("1")
    whole = picture(page, "#map")
    for k in range(1, 4):
        page.keyboard.press(str(k))
        assert picture(page, "#map") != whole
        page.keyboard.press(str(k))
        assert picture(page, "#map") == whole
    page.keyboard.press("t")
    assert picture(page, "#map") != whole

    drop(page, "square.tsp", SQUARE)
    expect(page, "#instance option:checked").to_have_text("square")
    drop(page, "bad.tsp", "NAME : x\nDIMENSION : many\n")
    expect(page, "#notice").to_contain_text("DIMENSION")
    page.click("#step")
    expect(page, "#best").to_have_text("40")
    name, data = saved(page, "tour")
    assert name == "square.tour" and b"TOUR_SECTION" in data and sorted(data.split()[-6:-2]) == [b"1", b"2", b"3", b"4"]
    name, data = saved(page, "png")
    assert name == "antway-square.png" and Image.open(io.BytesIO(data)).width > 600
    page.keyboard.press("r")
    expect(page, "#cycle").to_have_text("0")


def test_a_refusal_stays_while_answers_to_other_requests_come(page: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A refusal that comes before the answer to a later request is still shown after it, until the next request."""
    let = threading.Event()

    def slowly(self: Session, message: dict[str, Any], done: Any = Session.do_set) -> list[dict[str, Any]]:
        assert let.wait(60)
        return done(self, message)  # type: ignore[no-any-return]

    monkeypatch.setattr(Session, "do_set", slowly)
    page.reload()  # a session whose settings are slow
    page.wait_for_selector("body[data-ready=true]")
    page.fill("#seed", "-1")
    page.keyboard.press("Tab")
    page.click("#compare")
    expect(page, ".view").to_have_count(1)
    let.set()
    expect(page, ".view").to_have_count(2)
    expect(page, "#notice").to_contain_text("seed = -1")
    expect(page, "#seed").to_have_attribute("aria-invalid", "true")
    expect(page, "#seed").to_have_value("-1")
    page.click("#compare")
    expect(page, ".view").to_have_count(1)
    expect(page, "#notice").to_be_hidden()
    expect(page, "#seed").to_have_value("0")
    assert page.get_attribute("#seed", "aria-invalid") is None


def test_what_is_refused_is_said_beside_what_was_set(page: Any) -> None:
    """A radius too large for where the robot starts is refused beside the radius, though it is the start that is wrong."""
    page.click("details:has(#parameters) > summary")
    page.fill("[id='parameter-robot.radius']", "2")
    page.keyboard.press("Tab")
    expect(page, "[id='wrong-robot.radius']").to_contain_text("start = ")
    expect(page, "#notice").to_be_hidden()


def test_what_is_typed_stays_while_an_answer_comes(page: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A number that is being typed is not overwritten by the answer to a request before it."""
    let = threading.Event()

    def slowly(self: Session, message: dict[str, Any], done: Any = Session.do_policies) -> list[dict[str, Any]]:
        assert let.wait(60)
        return done(self, message)  # type: ignore[no-any-return]

    monkeypatch.setattr(Session, "do_policies", slowly)
    page.reload()
    page.wait_for_selector("body[data-ready=true]")
    for tool, field, typed in (("hand", "#seed", "12"), ("waypoints", "#pace", "0.25"), ("waypoints", "#size", "0.45")):
        let.clear()
        page.click(f"[data-tool={tool}]")
        views = page.locator(".view").count()
        page.click("#compare")
        page.fill(field, typed)
        let.set()
        expect(page, ".view").to_have_count(3 - views)
        expect(page, field).to_have_value(typed)
    page.click("[data-tool=hand]")
    expect(page, "#undo").to_be_enabled()


def test_a_cycle_without_ants_says_so(page: Any) -> None:
    """Where no ants take part in a cycle, a look inside it plays it and says why, in words; a step says no more of it."""
    for _ in range(40):  # they look for a better plan in some control cycles, and each look may take several of their own
        page.keyboard.press("a")
        page.wait_for_timeout(250)
        if "No ants" in page.locator(".card .ants").inner_text():
            break
    expect(page, ".card .ants").to_contain_text("No ants in this control cycle")
    page.click("#step")
    expect(page, ".card .ants").to_have_text("")
    page.locator(".view select").select_option("stop")
    expect(page, "#time").to_have_text("0.0 s")
    page.click("#ants")
    expect(page, ".card .ants").to_have_text("This policy has no ants.")


def test_a_page_that_waits_says_so(browser: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """While the server takes long over a step, as where it compiles, the page says that it works; then it says so no more."""
    let = threading.Event()

    def slowly(self: Session, done: Any = Session.advance) -> None:
        assert let.wait(60)
        done(self)

    monkeypatch.setattr(Session, "advance", slowly)
    page, complaints = opened(browser[0], browser[1], (browser[1], "data:"), **DESKTOP)
    expect(page, "#time").to_have_text("0.0 s")  # the first frame is there: it would end what the page says
    page.click("#step")
    expect(page, "#busy").to_contain_text("working")
    let.set()
    expect(page, "#time").to_have_text("0.1 s")
    expect(page, "#busy").to_have_text("")
    assert complaints == []
    page.context.close()
