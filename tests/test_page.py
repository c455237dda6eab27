"""The live page in a real browser: drawn on, run, stepped, compared, fed files, saved, attacked, looked at."""

from __future__ import annotations

import base64
import io
import re
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from antway import Grid, World, load_scenario
from antway.errors import BadInput
from antway.scenes import scene
from antway.web.files import read_upload
from antway.web.player import _parse
from antway.web.session import Session
from antway.world.motions import Bounce, Waypoints
from antway.world.scenario import Scenario, save_scenario
from browser import (
    DESKTOP,
    NASTY,
    ON_ITS_SIDE,
    PHONE,
    boxes,
    chromium,
    drag,
    drawn,
    drop,
    expect,
    fits,
    needs_browser,
    opened,
    pixels,
    point,
    saved,
)
from common import play
from serving import served

pytestmark = needs_browser
MAP = "type octile\nheight 8\nwidth 12\nmap\n" + "............\n" * 3 + "......@@....\n" * 2 + "............\n" * 3


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    warm = Session()  # compiles what the pages will run
    warm.apply({"op": "policies", "names": ["antway", "paper"]})
    play(warm, 40)
    warm.apply({"op": "ants"})
    warm.frame()
    with served() as port:
        yield f"http://127.0.0.1:{port}/"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as one:
        yield one


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Any]:
    """The live page on a desktop; at the end it must have said nothing in the console and asked nobody else for anything."""
    page, complaints = opened(browser, address, (address, "blob:", "data:"), **DESKTOP)
    yield page
    page.context.close()
    assert complaints == []


def scenario(page: Any, folder: Path) -> Scenario:
    """The scenario as the page saves it."""
    zipfile.ZipFile(io.BytesIO(saved(page, "scenario")[1])).extractall(folder)
    return load_scenario(folder / "scenario.toml")


def seconds(page: Any) -> float:
    return float(page.locator("#time").inner_text().split()[0])


def test_a_place_is_drawn(page: Any, tmp_path: Path) -> None:
    """Walls, goal, obstacles and waypoints are drawn by mouse and by keyboard, undone and redone; the saved file has them."""
    first = scenario(page, tmp_path)
    page.click("[data-tool=wall]")
    drag(page, (5.5, 1.5), (9.5, 1.5))
    expect(page, "#undo").to_be_enabled()
    page.keyboard.press("v")
    drag(page, (19.5, 19.5), (17.5, 18.5))
    page.keyboard.press("o")
    x, y = point(page, 15.5, 1.5)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 45, y, steps=5)
    page.mouse.up()
    expect(page, "#reset").to_be_enabled()
    page.keyboard.press("p")
    page.fill("#pace", "0.6")
    for place in ((13.5, 2.5), (13.5, 5.5), (7.5, 1.5), (14.5, 5.5)):
        page.mouse.click(*point(page, *place))
        if place == (7.5, 1.5):  # in the wall that was drawn
            expect(page, "#notice").to_contain_text("must be where the map is free")
    expect(page, "#notice").to_be_hidden()
    page.click("#done")
    expect(page, "#done").to_be_hidden()

    now = scenario(page, tmp_path)
    assert now.world.grid.blocked[1, 5:10].all() and not first.world.grid.blocked[1, 5:10].any()
    assert np.abs(np.array(now.goal) - (17.5, 18.5)).max() < 0.2
    thrown, walker = now.world.obstacles[-2:]
    assert isinstance(thrown.motion, Bounce) and thrown.motion.speed == pytest.approx(0.5, abs=0.05)
    assert abs(abs(thrown.motion.heading) - np.pi) < 1e-6  # type: ignore[arg-type, operator]
    assert isinstance(walker.motion, Waypoints) and walker.motion.speed == 0.6 and len(walker.motion.points) == 3

    for _ in range(4):
        expect(page, "#undo").to_be_enabled()
        page.keyboard.press("Control+z")
    expect(page, "#undo").to_be_disabled()
    assert scenario(page, tmp_path).world == first.world
    page.click("#redo")
    expect(page, "#undo").to_be_enabled()
    assert scenario(page, tmp_path).world.grid.blocked[1, 7]
    page.keyboard.press("e")
    page.mouse.click(*point(page, 7.5, 1.5))
    page.locator("canvas.stage").focus()
    page.keyboard.press("w")
    for key in ("ArrowUp", "ArrowUp", "ArrowRight", "Enter"):
        page.keyboard.press(key)
    now = scenario(page, tmp_path)
    assert now.world.grid.blocked[2, 1] and not now.world.grid.blocked[1, 7] and now.world.grid.blocked[1, 6]


def test_a_run_is_played_paused_and_stepped(page: Any) -> None:
    """Play, pause, one control cycle, one ant cycle, back to the start, and on to the goal."""
    page.select_option("#speed", "2")
    page.keyboard.press(" ")
    expect(page, "#time").not_to_have_text(re.compile(r"^0\."))
    page.click("#play")
    expect(page, "#play").to_have_attribute("aria-label", "Play")
    then = seconds(page)
    page.click("#step")
    expect(page, "#time").to_have_text(f"{then + 0.1:.1f} s")
    page.click("#reset")
    expect(page, "#time").to_have_text("0.0 s")
    page.click("#ants")
    expect(page, ".card .ants").to_contain_text("Ant cycle 1")
    expect(page, "#time").to_have_text("0.0 s")
    while page.locator(".card .ants").inner_text():
        before = page.locator(".card .ants").inner_text()
        page.keyboard.press("a")
        expect(page, ".card .ants").not_to_have_text(before)
    expect(page, "#time").to_have_text("0.1 s")
    page.select_option("#speed", "8")
    page.click("#play")
    expect(page, ".outcome").to_have_text("reached")
    expect(page, "#play").to_be_disabled()
    assert "driven" in page.locator(".numbers").inner_text() and "the goal" in page.locator(".reason").inner_text()
    page.reload()
    expect(page, "#time").to_have_text("0.0 s")
    expect(page, "#play").to_be_enabled()


def test_every_layer_has_a_switch_that_works(page: Any) -> None:
    """Each layer's box, legend and key change the picture of a run in the midst of an encounter."""
    for step in range(1, 120):
        page.keyboard.press("ArrowRight")
        expect(page, "#time").to_have_text(f"{step / 10:.1f} s")
        if page.locator(".action").inner_text() == "avoid":
            break
    if not page.locator("#layer-field").is_checked():
        page.keyboard.press("0")

    def picture() -> bytes:
        drawn(page)
        return base64.b64decode(page.evaluate("document.querySelector('canvas.stage').toDataURL()").split(",")[1])

    boxes = page.locator("#layers input")
    assert boxes.count() == 10
    for k in range(10):
        before = picture()
        page.keyboard.press(str((k + 1) % 10))
        assert not boxes.nth(k).is_checked()
        assert picture() != before, boxes.nth(k).get_attribute("id")
        boxes.nth(k).click()
        assert picture() == before


def test_files_are_opened_and_bad_ones_said(page: Any, tmp_path: Path) -> None:
    """Maps open by the chooser and by drag and drop; what is wrong with a file is said, and the run goes on unharmed."""
    Image.fromarray(np.pad(np.full((10, 10), 255, np.uint8), 1)).save(tmp_path / "room.png")
    page.set_input_files("#files", tmp_path / "room.png")
    page.fill("#pixel", "1")
    page.click("#pixel-open")
    expect(page, "#scene option:checked").to_have_text("room")
    (tmp_path / "bad.png").write_bytes(b"\x89PNG no more")
    page.set_input_files("#files", tmp_path / "bad.png")
    page.click("#pixel-open")
    expect(page, "#notice").to_contain_text("bad.png")
    page.set_input_files("#files", tmp_path / "room.png")
    expect(page, "#notice").to_be_hidden()
    page.keyboard.press("Escape")
    page.set_input_files("#files", tmp_path / "bad.png")
    page.click("#pixel-open")
    expect(page, "#notice").to_contain_text("bad.png")
    page.click("#notice button")
    expect(page, "#notice").to_be_hidden()
    drop(page, "dropped.map", MAP)
    expect(page, "#scene option:checked").to_have_text("dropped")
    page.click("#step")
    expect(page, "#time").to_have_text("0.1 s")
    page.click("details:has(#parameters) > summary")
    for text in ("99", "wide", ""):
        page.fill("[id='parameter-robot.radius']", text)
        page.keyboard.press("Tab")
        expect(page, "[id='wrong-robot.radius']").to_contain_text("robot.radius")
        expect(page, "[id='parameter-robot.radius']").to_have_attribute("aria-invalid", "true")
    expect(page, "#time").to_have_text("0.1 s")
    page.fill("[id='parameter-robot.radius']", "0.2")
    page.keyboard.press("Tab")
    expect(page, "[id='wrong-robot.radius']").to_have_text("")
    expect(page, "#time").to_have_text("0.0 s")


def test_two_policies_are_compared_and_everything_is_saved(page: Any, tmp_path: Path) -> None:
    """Two views play in step; PNG, GIF, trace, replay page and link are what they say, and the link opens the same."""
    page.click("#compare")
    expect(page, ".view").to_have_count(2)
    page.locator(".view select").nth(1).select_option("stop")
    expect(page, ".card h2").to_have_text(["Decision of antway", "Decision of stop"])
    page.select_option("#speed", "2")
    page.click("#play")
    expect(page, "#time").not_to_have_text(re.compile(r"^0\."))
    page.click("#play")
    expect(page, "#play").to_have_attribute("aria-label", "Play")
    times = [text.split(" s")[0] for text in page.locator(".numbers").all_inner_texts()]
    assert times[0] == times[1]
    name, data = saved(page, "png")
    assert name == "antway-paper.png" and Image.open(io.BytesIO(data)).width > 800
    name, data = saved(page, "gif")
    assert name == "paper-antway-stop.gif" and Image.open(io.BytesIO(data)).n_frames > 20
    name, data = saved(page, "replay")
    assert name == "paper-antway-stop.html" and len(data) < 2_000_000
    with page.expect_download(lambda file: file.suggested_filename == "paper-stop.json", timeout=60_000):
        name, data = saved(page, "trace")
    assert name == "paper-antway.json" and data.startswith(b"{")

    page.fill("#seed", "7")
    page.keyboard.press("Tab")
    expect(page, "#undo").to_be_enabled()
    page.click(".menu summary")
    page.click("#save-link")
    expect(page, "#link-box").to_be_visible()
    link = page.locator("#link").input_value()
    page.click("#close-link")
    page.goto("about:blank")
    page.goto(link)
    expect(page, "#ask-box").to_be_visible()
    expect(page, ".view").to_have_count(1)
    page.click("#ask-drop")
    assert page.url.endswith("/"), "a link that is left is forgotten"
    page.goto(link)  # only what is after # differs, so that the page is not loaded anew
    expect(page, "#ask-box").to_be_visible()
    page.click("#ask-drop")
    assert page.url.endswith("/")
    expect(page, "#seed").not_to_have_value("7")
    page.goto("about:blank")
    page.goto(link)
    page.click("#ask-open")
    expect(page, ".view").to_have_count(2)
    expect(page, "#seed").to_have_value("7")
    assert page.url.endswith("/") and scenario(page, tmp_path).seed == 7


def test_nothing_from_a_file_is_markup(page: Any, tmp_path: Path) -> None:
    """C41: 30 hostile names of scenarios, files and values are shown as text, run nothing and ask the network for nothing."""
    template = load_scenario(scene("paper"))
    for text in NASTY:
        folder = tmp_path / str(NASTY.index(text))
        folder.mkdir()
        named = Scenario(**{f: getattr(template, f) for f in ("world", "start", "goal", "robot", "horizon")}, name=text)
        save_scenario(named, folder / "s.toml")
        page.set_input_files("#files", sorted(folder.iterdir()))
        expect(page, "#undo").to_be_enabled()
        expect(page, "#scene option:checked").to_have_js_property("textContent", text)
        drop(page, f"{text.replace('/', ':')}.map", "x")
        expect(page, "#notice").to_be_visible()
        assert "must be" in page.locator("#notice").inner_text()
        page.click("#notice button")
        page.fill("#seed", text.replace("\u2028", " ").replace("\0", ""))
        page.keyboard.press("Tab")
        expect(page, "#notice").to_contain_text("seed")
        page.click("#notice button")
        assert page.evaluate("window.hit") is None, text
    assert page.locator("iframe, object, embed, base, img").count() == 0


def at(page: Any, x: float, y: float) -> list[int]:
    """Red, green and blue of the stage at the place (x, y) m of a square map of 20 m."""
    drawn(page)
    left, top = point(page, x, y)
    return page.evaluate(  # type: ignore[no-any-return]
        """([left, top]) => {
          const stage = document.querySelector("canvas.stage");
          const box = stage.getBoundingClientRect();
          const k = stage.width / box.width;
          const c = document.createElement("canvas").getContext("2d");
          c.drawImage(stage, k * (left - box.left), k * (top - box.top), 1, 1, 0, 0, 1, 1);
          return [...c.getImageData(0, 0, 1, 1).data.slice(0, 3)];
        }""",
        [left, top],
    )


def test_what_is_sensed_ends_at_walls(page: Any) -> None:
    """Of two places as far from the robot, the one in sight is shaded as sensed, and the one behind a wall is not."""
    page.click("[data-tool=wall]")
    drag(page, (2.5, 0.5), (2.5, 3.5))
    expect(page, "#undo").to_be_enabled()
    seen, hidden = (1.3, 3.3), (3.3, 1.3)
    shaded, plain = at(page, *seen), at(page, *hidden)
    assert shaded != plain
    page.keyboard.press("6")
    assert at(page, *seen) == at(page, *hidden) == plain


def test_a_bad_file_leaves_a_run_that_plays_alone(page: Any) -> None:
    """While a run plays, a file that is none is refused in the library's own words, and the run plays on, of the same place."""
    page.click("#play")
    expect(page, "#time").not_to_have_text("0.0 s")
    drop(page, "bad.map", "type octile\nheight 3\nwidth x\nmap\n")
    expect(page, "#notice").to_contain_text("width")
    with pytest.raises(BadInput) as refused:
        text = base64.b64encode(b"type octile\nheight 3\nwidth x\nmap\n").decode()
        read_upload([{"name": "bad.map", "data": text}])
    expect(page, "#notice span").to_have_text(str(refused.value))
    then = page.locator("#time").inner_text()
    expect(page, "#time").not_to_have_text(then)
    expect(page, "#play").to_have_attribute("aria-label", "Pause")
    expect(page, "#notice").to_be_visible()
    expect(page, "#scene").to_have_value("paper")


def until(page: Any, holds: Callable[[], bool]) -> None:
    """Wait for what the next picture is to show."""
    for _ in range(100):
        if holds():
            return
        page.wait_for_timeout(50)
    raise AssertionError("not within 5 s")


def test_touch_draws_drags_and_zooms(browser: Any, address: str, tmp_path: Path) -> None:
    """On a phone one finger drags the goal and throws an obstacle, two fingers zoom, and the canvas has the screen's pixels.

    Buttons are clicked: Chromium may swallow a tap that follows touches as fast as these.
    """
    page, complaints = opened(browser, address, (address, "blob:", "data:"), **PHONE)
    wire = page.context.new_cdp_session(page)

    def touch(*moments: list[tuple[float, float]]) -> None:
        """Fingers at these places of the screen one moment after the other, then lifted."""
        for k, places in enumerate(moments):
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
            wire.send("Input.dispatchTouchEvent", {"type": "touchMove" if k else "touchStart", "touchPoints": points})
        wire.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    sizes = page.evaluate("(() => { const c = document.querySelector('canvas.stage'); return [c.width, c.clientWidth]; })()")
    assert sizes[0] == pytest.approx(2 * sizes[1], abs=1)
    touch([point(page, 19.5, 19.5)], [point(page, 18.5, 19.0)], [point(page, 17.5, 18.5)])
    expect(page, "#undo").to_be_enabled()
    page.click("button[data-tool=obstacle]")
    x, y = point(page, 15.5, 1.5)
    touch([(x, y)], [(x - 20, y)], [(x - 45, y)])
    page.click("button[data-tool=waypoints]")
    expect(page, "button[data-tool=waypoints]").to_have_attribute("aria-pressed", "true")
    for place in ((13.5, 2.5), (13.5, 5.5), (14.5, 5.5)):
        touch([point(page, *place)])
    page.click("#done")
    now = scenario(page, tmp_path)
    assert np.abs(np.array(now.goal) - (17.5, 18.5)).max() < 0.3
    thrown, walker = now.world.obstacles[-2:]
    assert isinstance(thrown.motion, Bounce) and thrown.motion.speed == pytest.approx(0.5, abs=0.05)
    assert isinstance(walker.motion, Waypoints) and len(walker.motion.points) == 3
    page.click("button[data-tool=hand]")
    walls = pixels(page, "wall")
    x, y = point(page, 10.0, 10.0)
    touch(*([(x - d, y), (x + d, y)] for d in (30.0, 60.0, 90.0)))
    until(page, lambda: pixels(page, "wall") != walls)
    page.click("#fit")
    until(page, lambda: pixels(page, "wall") == walls)
    assert complaints == []
    page.context.close()


def test_a_closed_tab_ends_its_simulation(browser: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a tab that plays is closed or reloaded its session is over, and no cycle of it is played any more."""
    from antway.web import server

    sessions: list[Session] = []

    class Known(Session):
        def __init__(self) -> None:
            super().__init__()
            sessions.append(self)

    monkeypatch.setattr(server, "Session", Known)
    with served() as port:
        own = f"http://127.0.0.1:{port}/"
        page, complaints = opened(browser, own, (own, "data:"), **DESKTOP)
        for leave in (page.reload, page.close):
            page.click("#play")
            expect(page, "#time").not_to_have_text("0.0 s")
            leave()
            assert sessions[-1 if page.is_closed() else 0].closed.wait(30)
        assert len(sessions) == 2
        steps = [session.views[0].episode.steps for session in sessions]
        time.sleep(0.5)
        assert steps == [session.views[0].episode.steps for session in sessions]
    assert complaints == []


def test_a_server_that_is_gone_is_said(browser: Any) -> None:
    """When the server ends, the page says so and offers no control that does nothing."""
    with served() as port:
        own = f"http://127.0.0.1:{port}/"
        page, _ = opened(browser, own, (own, "data:"), **DESKTOP)
    expect(page, "#notice").to_contain_text("open the address that it prints")  # a new server has another token
    assert page.locator("button:enabled:visible").count() == 1, "the theme's alone"
    page.keyboard.press("Escape")
    page.keyboard.press("t")  # is done after it
    expect(page, "#notice").to_be_visible()
    page.context.close()


@pytest.mark.parametrize("width", [800, 801])
def test_choosers_are_wide_enough_for_their_names(browser: Any, address: str, width: int) -> None:
    """On both sides of the width at which the layout changes, `antway` is read beside the arrow of its chooser."""
    page, _ = opened(browser, address, (address, "data:"), viewport={"width": width, "height": 600})
    assert page.locator(".view select").bounding_box()["width"] > 80
    page.context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("screen", [DESKTOP, PHONE, ON_ITS_SIDE], ids=["desktop", "phone", "on its side"])
@pytest.mark.parametrize("path", ["", "tsp"])
def test_the_pages_fit_the_screen(browser: Any, address: str, path: str, screen: dict[str, Any], scheme: str) -> None:
    """On a desktop and on a phone nothing runs off the side, buttons are large enough, and every control has a name."""
    page, complaints = opened(browser, address + path, (address, "data:"), color_scheme=scheme, **screen)
    fits(page, screen)
    assert page.evaluate("document.documentElement.dataset.theme") == scheme
    if path:
        (page.tap if screen is PHONE else page.click)("#step")
        expect(page, "#cycle").to_have_text("1")
        assert pixels(page, "ink", "#map") > 200
    else:
        assert pixels(page, "wall") > 100 and pixels(page, "robot") > 20
        if screen is PHONE:
            tops = {box["y"] for box in boxes(page.locator(".bar button:visible"))}
            assert len(tops) == 2, "two rows of them, one with the slider, leave room for the map"
            page.tap("[data-tool=wall]")
            page.touchscreen.tap(*point(page, 0.5, 18.5))
            expect(page, "#undo").to_be_enabled()
    assert complaints == []
    page.context.close()


@pytest.mark.parametrize(
    "size, least", [((320, 640), 200), ((844, 390), 130), ((640, 360), 70)], ids=["small", "side", "zoomed"]
)
def test_a_small_screen_shows_most_of_the_map(browser: Any, address: str, size: tuple[int, int], least: int) -> None:
    """On a small phone, on one on its side and at 200 % of a low window the rows above and below leave room for it."""
    screen = {**PHONE, "viewport": {"width": size[0], "height": size[1]}}
    page, _ = opened(browser, address, (address, "data:"), **screen)
    assert page.locator(".bar").bounding_box()["y"] - page.locator(".stage").bounding_box()["y"] > least
    page.context.close()


def test_a_colony_solves_in_the_browser(browser: Any, address: str) -> None:
    """The ring of 40 cities is solved: the gap falls to 0, the curve is drawn, and the colony's settings are kept."""
    page, complaints = opened(browser, f"{address}tsp", (address, "data:"), **DESKTOP)
    page.select_option("#instance", "ring")
    page.select_option("#set-search", "2opt")
    page.fill("#set-ants", "0")
    page.keyboard.press("Tab")
    expect(page, "#settings .wrong >> nth=3").to_contain_text("ants = 0")
    page.fill("#set-ants", "10")
    page.keyboard.press("Tab")
    page.select_option("#speed", "64")
    page.click("#play")
    expect(page, "#gap").to_have_text("0 %, the shortest")
    expect(page, "#play").to_be_disabled()
    assert pixels(page, "robot", "#map") > 500 and pixels(page, "robot", "#curve") > 10
    page.keyboard.press("2")
    assert pixels(page, "robot", "#map") == 0
    page.click("#reset")
    expect(page, "#cycle").to_have_text("0")
    assert complaints == []
    page.context.close()


@pytest.mark.parametrize("screen", [{"viewport": {"width": 1400, "height": 900}}, PHONE], ids=["1400", "390"])
@pytest.mark.parametrize("colours", ["light", "dark"])
def test_controls_are_inside_their_boxes(browser: Any, address: str, screen: dict[str, Any], colours: str) -> None:
    """The save menu and each other control are within their boxes, and these within the screen, as ruler and help are."""
    page, complaints = opened(browser, address, (address, "blob:", "data:"), **screen, color_scheme=colours)
    width = screen["viewport"]["width"]
    page.click(".menu summary")
    menu = page.locator(".menu div").bounding_box()
    assert menu["x"] >= 0 and menu["x"] + menu["width"] <= width and menu["width"] > 200
    items = page.locator(".menu div button")
    for box in boxes(items):
        assert box["x"] >= menu["x"] and box["x"] + box["width"] <= menu["x"] + menu["width"]
    assert items.evaluate_all("all => all.every((e) => e.scrollWidth <= e.clientWidth + 1)")
    page.keyboard.press("Escape")
    said = "Edits of “paper”, Nov 22, 3:43 PM, are kept here."
    page.locator("#kept span").evaluate("(e, text) => { e.textContent = text; e.parentElement.hidden = false; }", said)
    controls = {".bar": "button, select, #scrub", "#kept": "button", "main": ".palette button", "aside": ".mark, label"}
    for box_of, parts in controls.items():
        outer = page.locator(box_of).bounding_box()
        found = page.locator(box_of).locator(parts)
        wide = found.evaluate_all("all => all.map((e) => e.scrollWidth > e.clientWidth + 2)")
        for inner, is_wide in zip(boxes(found), wide, strict=True):
            if not inner:
                continue  # not shown
            assert inner["x"] >= outer["x"] - 1 and inner["x"] + inner["width"] <= outer["x"] + outer["width"] + 1, parts
            inside = inner["y"] >= outer["y"] - 1 and inner["y"] + inner["height"] <= outer["y"] + outer["height"] + 1
            assert inside or box_of == "aside", parts  # which scrolls
            assert not is_wide, parts
    ruler = page.locator(".ruler")
    assert 20 < ruler.bounding_box()["width"] <= 120 and ruler.inner_text().endswith(" m")
    assert ruler.evaluate("e => getComputedStyle(e).backgroundColor") != "rgba(0, 0, 0, 0)", "it is read over walls, too"
    facts = "<dt>wait 1.25 s, then the direct path</dt><dd>+1.2 s</dd><dt>Closest approach</dt><dd>0.46 m in 2.6 s</dd>"
    page.locator(".facts").evaluate("(e, text) => { e.innerHTML = text; }", facts)
    lines = "e => { const text = document.createRange(); text.selectNodeContents(e); return text.getClientRects().length; }"
    counts = [value.evaluate(lines) for value in page.locator(".facts dd").all()]
    assert counts == [1, 1], "values stay in one line beside a long name"
    if screen is not PHONE:
        page.click("#help")
        expect(page, "#keys").to_have_attribute("open", "")
    fits(page, screen)
    page.context.close()
    assert complaints == []


def test_a_run_is_looked_back_at(page: Any) -> None:
    """Step back and the slider show earlier moments as they were; play and step go on from there, and then with new cycles."""
    shown: list[str] = [page.locator(".numbers").inner_text()]
    for step in range(1, 9):
        page.keyboard.press("ArrowRight")
        expect(page, "#time").to_have_text(f"{step / 10:.1f} s")
        shown.append(page.locator(".numbers").inner_text())
    for step in (7, 6):
        page.click("#back")
        expect(page, "#time").to_have_text(f"{step / 10:.1f} s")
        assert page.locator(".numbers").inner_text() == shown[step]
    page.locator("#scrub").focus()
    page.keyboard.press("Home")
    expect(page, "#time").to_have_text("0.0 s")
    expect(page, "#back").to_be_disabled()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    expect(page, "#time").to_have_text("0.3 s")
    assert page.locator(".numbers").inner_text() == shown[3]
    assert page.locator("#scrub").get_attribute("aria-valuetext") == "0.3 s of 0.8 s"
    for key, label in ((" ", "Pause"), (" ", "Play"), ("r", "Play")):  # the slider takes the arrows alone
        page.keyboard.press(key)
        expect(page, "#play").to_have_attribute("aria-label", label)
    expect(page, "#time").to_have_text("0.0 s")
    for step in range(1, 10):
        page.click("#step")
        expect(page, "#time").to_have_text(f"{step / 10:.1f} s")
        assert step > 8 or page.locator(".numbers").inner_text() == shown[step]


def test_edits_are_kept_and_offered(page: Any, tmp_path: Path) -> None:
    """After an edit and a reload the edit is offered and restored; what is forgotten, or left for another scene, is not."""
    kept = "localStorage.getItem('antway-edits') !== null"
    assert not page.evaluate(kept) and page.locator("#kept").is_hidden()
    for key in ("Control+z", "Control+Shift+z", "r"):  # there is nothing to undo or redo
        page.keyboard.press(key)
    page.wait_for_timeout(1500)  # half a second more than an edit is kept after
    assert not page.evaluate(kept)
    page.fill("#seed", "5")
    page.keyboard.press("Tab")
    until(page, lambda: page.evaluate(kept))
    page.reload()
    expect(page, "#kept").to_contain_text("paper")
    expect(page, "#seed").to_have_value("0")
    page.click("#restore")
    expect(page, "#seed").to_have_value("5")
    expect(page, "#kept").to_be_hidden()
    assert scenario(page, tmp_path).seed == 5
    page.reload()
    page.click("#forget")
    expect(page, "#kept").to_be_hidden()
    assert not page.evaluate(kept)
    page.fill("#seed", "6")
    page.keyboard.press("Tab")
    until(page, lambda: page.evaluate(kept))
    page.select_option("#scene", "office")
    expect(page, "#scene option:checked").to_have_text("office")
    assert not page.evaluate(kept)


def test_edits_that_another_tab_keeps_stay(page: Any) -> None:
    """Another scene removes only what this tab has kept; what cannot be read, or is blocked, is as nothing, and scenes open."""
    keep = "at => localStorage.setItem('antway-edits', JSON.stringify({ name: 'other', policies: [], data: 'x', at }))"
    kept = "localStorage.getItem('antway-edits')"
    page.evaluate(keep, 1)
    page.reload()
    expect(page, "#kept").to_contain_text("other")
    page.select_option("#scene", "office")
    until(page, lambda: page.title().startswith("office"))
    assert '"other"' in page.evaluate(kept)
    page.fill("#seed", "6")
    page.keyboard.press("Tab")
    until(page, lambda: '"office"' in page.evaluate(kept))
    page.evaluate(keep, 2)
    page.select_option("#scene", "paper")
    until(page, lambda: page.title().startswith("paper"))
    assert '"other"' in page.evaluate(kept)
    page.evaluate("localStorage.setItem('antway-edits', '{')")
    blocked = "Object.defineProperty(window, 'localStorage', { get() { throw Error('blocked'); } })"
    page.add_init_script(f"if (window.name === 'blocked') {blocked}")
    for name in ("spoilt", "blocked"):
        page.evaluate("to => (window.name = to)", name)
        page.reload()
        until(page, lambda: page.title().startswith("paper"))
        expect(page, "#kept").to_be_hidden()
        page.select_option("#scene", "office")
        until(page, lambda: page.title().startswith("office"))


def test_two_tabs_keep_their_edits_side_by_side(page: Any, address: str, tmp_path: Path) -> None:
    """What one tab keeps no longer overwrites what another has kept: both are offered, the newest first, and at most five."""
    kept = "(JSON.parse(localStorage.getItem('antway-edits')) ?? []).length"
    other = page.context.new_page()
    other.goto(address)
    for number, tab in enumerate((page, other), 1):
        for seed in (10 * number, 10 * number + 1):
            tab.fill("#seed", str(seed))
            tab.keyboard.press("Tab")
            tab.wait_for_timeout(1500)
        until(tab, lambda number=number, tab=tab: tab.evaluate(kept) == number)
    other.close()
    page.reload()
    page.click("#forget")
    expect(page, "#kept").to_contain_text("paper")
    page.click("#restore")
    expect(page, "#seed").to_have_value("11")
    old = "[5, 4, 3, 2, 1].map((at) => ({ name: `old ${at}`, policies: [], data: 'x', at }))"
    page.evaluate(f"localStorage.setItem('antway-edits', JSON.stringify({old}))")
    page.fill("#seed", "12")
    page.keyboard.press("Tab")
    until(page, lambda: page.evaluate("localStorage.getItem('antway-edits')").count("old") == 4)
    assert page.evaluate(kept) == 5 and scenario(page, tmp_path).seed == 12


@pytest.mark.parametrize("path", ["", "tsp"])
def test_terms_are_explained_by_pointer_and_keyboard(browser: Any, address: str, path: str) -> None:
    """What a term means is shown under the pointer and in focus, within the screen, named to screen readers, until Escape."""
    page, complaints = opened(browser, address + path, (address, "data:"), **PHONE)
    terms = page.locator("[data-tip]:visible")
    assert terms.count() >= (4 if path else 7)
    for term in terms.all():
        if not term.inner_text():
            continue
        term.scroll_into_view_if_needed()
        for show in (term.hover, term.focus):
            show()
            expect(page, "#tip").to_have_text(term.get_attribute("data-tip"))
            assert term.get_attribute("aria-describedby") == "tip"
            box = page.locator("#tip").bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= 390 and box["y"] >= 0 and box["y"] + box["height"] <= 844
            page.keyboard.press("Escape")
            expect(page, "#tip").to_be_hidden()
        term.blur()
    assert complaints == []
    page.context.close()


def test_a_shade_from_which_pixels_are_walls(page: Any, tmp_path: Path) -> None:
    """Beside the size of a pixel the page asks from how much black on a pixel is a wall; what is neither is marked."""
    grey = np.full((10, 10), 255, np.uint8)
    grey[4, 2:8] = 153  # 40 % black
    Image.fromarray(grey).save(tmp_path / "grey.png")
    for share, count in (("50", 0), ("40", 6)):
        page.set_input_files("#files", tmp_path / "grey.png")
        page.fill("#pixel", "1")
        page.fill("#occupied", "0")
        page.click("#pixel-open")
        expect(page, "#occupied").to_have_attribute("aria-invalid", "true")
        page.fill("#occupied", share)
        page.click("#pixel-open")
        expect(page, "#pixel-box").to_be_hidden()
        expect(page, "#scene option:checked").to_have_text("grey")
        expect(page, "#busy").to_have_text("")
        assert scenario(page, tmp_path).world.grid.blocked.sum() == count


def test_cities_are_added_and_removed(browser: Any, address: str) -> None:
    """On the page of tours a press on the map adds a city and one on it removes it, by the mouse and by the keyboard."""
    page, complaints = opened(browser, f"{address}tsp", (address, "data:"), **DESKTOP)
    page.select_option("#instance", "drawn")
    label = page.locator("#map")
    expect(page, "#map").to_have_attribute("aria-label", re.compile("^4 cities"))
    box = label.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for count in (5, 4, 5):
        page.mouse.click(x, y)
        expect(page, "#map").to_have_attribute("aria-label", re.compile(f"^{count} cities"))
    page.mouse.click(box["x"] + 5, y)  # beside the map
    label.focus()
    for key in ("ArrowUp", "ArrowUp", "ArrowUp", "ArrowRight", "Enter"):
        page.keyboard.press(key)
    expect(page, "#map").to_have_attribute("aria-label", re.compile("^6 cities"))
    page.click("#step")
    expect(page, "#cycle").to_have_text("1")
    page.mouse.click(x, y)
    expect(page, "#cycle").to_have_text("0")
    assert complaints == []
    page.context.close()


def test_a_description_alone_and_the_cursor(page: Any, tmp_path: Path) -> None:
    """A lone YAML asks for its picture; the place under the cursor is told in metres."""
    (tmp_path / "hall.yaml").write_text("image: hall.pgm\n")
    page.set_input_files("#files", tmp_path / "hall.yaml")
    expect(page, "#notice").to_contain_text("choose its picture too")
    page.click("#notice button")
    page.mouse.move(*point(page, 5.0, 15.0))
    expect(page, ".place").to_have_text(re.compile(r"^[45]\.\d+ m, 1[45]\.\d+ m$"))


def test_a_wall_of_one_cell_is_drawn_on_a_large_map(page: Any) -> None:
    """Where a pixel shows several cells, a wall one cell thick is drawn where it is, whichever row is on top."""
    shown = page.evaluate("""async () => {
      const { Stage } = await import("/canvas.js");
      const drawn = [];
      for (const top_first of [false, true])
        for (const [rows, row, col] of [[1000, 999, 401], [1000, 2, 402], [900, 500, 403], [300, 7, 390]]) {
          const cols = 700;
          const [stage, mask] = [new Stage(document.createElement("canvas")), document.createElement("canvas")];
          [stage.canvas.width, stage.canvas.height, mask.width, mask.height] = [220, 310, cols, rows];
          const c = mask.getContext("2d");
          c.fillRect(col, 0, 1, rows);
          c.fillRect(0, row, cols, 1);
          stage.map = { top_first };
          stage.drawMask(mask, "#000", [5, 5, 210, 300]);
          const data = stage.context.getImageData(0, 0, 220, 310).data;
          const dark = (x, y) => data[(y * 220 + x) * 4 + 3] === 255;
          const y = top_first ? 305 - (row / rows) * 300 : 5 + (row / rows) * 300;
          const near = (at, is) => [-2, -1, 0, 1, 2].some((d) => is(Math.round(at) + d));
          const across = [...Array(220).keys()].filter((x) => near(y, (one) => one >= 0 && one < 310 && dark(x, one))).length;
          const along = [...Array(310).keys()].filter((one) => near(5 + (col / cols) * 210, (x) => dark(x, one))).length;
          drawn.push([across, along]);
        }
      return drawn;
    }""")
    assert shown == [[210, 300]] * 8


def test_a_press_on_the_goal_moves_nothing_and_a_drag_keeps_its_distance(page: Any, tmp_path: Path) -> None:
    """A click near the goal leaves the run as it is; a drag moves the goal by as much as the pointer, not to the pointer."""
    page.click("#step")
    expect(page, "#time").to_have_text("0.1 s")
    page.mouse.click(*point(page, 19.3, 19.4))
    page.mouse.move(*point(page, 19.3, 19.4))
    page.mouse.down()
    page.mouse.move(point(page, 19.3, 19.4)[0] + 2, point(page, 19.3, 19.4)[1])
    page.mouse.up()
    page.wait_for_timeout(300)
    expect(page, "#undo").to_be_disabled()
    expect(page, "#time").to_have_text("0.1 s")
    drag(page, (19.3, 19.4), (17.3, 18.4))
    expect(page, "#undo").to_be_enabled()
    expect(page, "#time").to_have_text("0.0 s")
    assert np.abs(np.array(scenario(page, tmp_path).goal) - (17.5, 18.5)).max() < 0.05


def test_a_long_stroke_is_taken_whole(page: Any) -> None:
    """A stroke of 75,000 cells is a few requests that the server takes, and paints what was under the brush."""
    sent = page.evaluate("""async () => {
      const { Editor } = await import("/edit.js");
      const [sent, stage] = [[], { unit: 1, scale: 1 }];
      const scene = { map: { rows: 400, cols: 400, resolution: 1, x: 0, y: 0 } };
      const editor = new Editor({ scene, tool: "wall", brush: 1, request: (message) => sent.push(message), redraw() {} });
      editor.gesture = editor.start({ stage }, null, [11.5, 3.5]);
      for (let x = 11.5; x < 390; x += 4)
        for (const place of [[x, 396.5], [x + 2, 396.5], [x + 2, 3.5], [x + 4, 3.5]]) editor.stroke(editor.gesture, place);
      editor.end();
      return sent.map((message) => JSON.stringify(message));
    }""")
    session = Session()
    session.apply({"op": "policies", "names": ["follow"]})
    session._open(Scenario(World(Grid(np.zeros((400, 400), bool))), (3.5, 200.5), (397.5, 200.5)))
    for text in sent:
        session.apply(_parse(text))
    assert len(sent) == 3 and 70_000 < session.scenario.world.grid.blocked.sum() < 80_000


def test_what_is_told_between_two_frames(page: Any) -> None:
    """The path driven ends at the robot where a frame covers several cycles; the worst time is that of the cycles counted."""
    worst, long, robot, trail = page.evaluate("""async () => {
      const { View } = await import("/view.js");
      const card = document.querySelector(".card");
      const text = card.querySelector(".cycle span");
      const spark = (ms) => View.prototype.spark.call({ card, ms, now: { at: ms.length }, stage: { colour: {} } });
      spark(Array(120).fill(1234.56));
      const long = [text.textContent, text.getBoundingClientRect().right <= card.getBoundingClientRect().right];
      spark([0.02, 0.04, 0.03]);
      const at = (t, x, n) => ({ t, robot: [x, 0, 0], obstacles: [], tubes: [], braking: [0, 0, 0], at: n });
      const view = {
        before: at(1.0, 1.0, 10), now: at(1.4, 1.4, 14), arrived: 0, trail: Array.from({ length: 15 }, (_, i) => [i / 10, 0]),
        editor: {}, page: { playing: true, speed: 8, scene: { start: [0, 0], goal: [9, 9], radii: [] } },
      };
      const moment = View.prototype.moment.call(view, 20);
      return [text.textContent, long, moment.robot.x, moment.trail.map(([x]) => x)];
    }""")
    assert worst == "cycle 0.03 ms, worst of 3: 0.04 ms"
    assert long == ["cycle 1235 ms, worst of 120: 1235 ms", True], "it fits in the panel"
    assert robot == pytest.approx(1.16) and trail[-1] == robot and trail == sorted(trail)
    assert trail == pytest.approx([*(k / 10 for k in range(12)), 1.16])
