"""The replay page, as text and in a real browser."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from antway import Decision, Grid, RobotSpec, Scenario, World, run
from antway.view.figures import shortest
from antway.view.replay import replay_page, write_replay
from antway.world.motions import Line
from antway.world.timeline import Timeline
from antway.world.world import Obstacle
from browser import DESKTOP, NASTY, ON_ITS_SIDE, PHONE, chromium, drawn, fits, needs_browser, opened, pixels
from sample import sample_trace

OWN = ("file:", "data:")


def data_of(page: str) -> Any:
    return json.loads(re.search(r'<script type="application/json" id="episode">(.*?)</script>', page, re.DOTALL)[1])


def places(packed: str, box: dict[str, float]) -> np.ndarray:
    """Unpack places, [N, 2] in m, as the page's script does."""
    raw = np.frombuffer(base64.b64decode(packed), "<u2").reshape(-1, 2) / 65535
    return raw * [box["width"], box["height"]] + [box["x"], box["y"]]


def test_a_minute_among_twenty_obstacles_takes_less_than_two_megabytes() -> None:
    """60 s at 10 Hz with 20 obstacles and fresh pheromone every cycle fit into 2 MB."""
    trace = sample_trace(600, 20)
    rng = np.random.default_rng(0)
    temperature = [(2, 3, rng.random((40, 40)).astype(np.float32)) for _ in range(600)]
    path = trace.decisions[1][1].path
    decisions = tuple(
        (i, Decision("avoid", f"{i} " + 100 * "x", obstacle=1, path=path, pheromone=temperature[i])) for i in range(600)
    )
    object.__setattr__(trace, "decisions", decisions)
    assert len(replay_page(trace, shortest=shortest(trace.task)).encode()) < 2_000_000


def test_the_page_holds_the_episode_to_a_millimetre() -> None:
    """Places unpacked from the page are within 1 mm of the trace, and sensed flags are equal."""
    trace = sample_trace(150, 3)
    data = data_of(replay_page(trace))
    assert np.abs(places(data["robot"]["xy"], data["box"]) - trace.xy).max() < 1e-3
    obstacles = places(data["obstacles"]["xy"], data["obstacles"]["box"]).reshape(trace.obstacle_xy.shape)
    assert np.abs(obstacles - trace.obstacle_xy).max() < 1e-3
    flags = np.unpackbits(np.frombuffer(base64.b64decode(data["obstacles"]["sensed"]), np.uint8), bitorder="little")
    assert (flags[: trace.sensed.size].reshape(trace.sensed.shape) == trace.sensed).all()
    assert [d["step"] for d in data["decisions"]] == [step for step, _ in trace.decisions]
    assert len(data["pheromone"]) < len(trace.decisions), "equal pheromone is stored once"


def test_the_policy_allows_only_the_pages_own_script_and_style() -> None:
    """The security policy names the hashes of the inline script and style, and nothing else may run or load."""
    page = replay_page(sample_trace(20, 1))
    policy = re.search(r'Content-Security-Policy" content="(.*?)"', page)[1]
    for kind, pattern in (("script", r'<script type="module">(.*?)</script>'), ("style", r"<style>(.*?)</style>")):
        text = re.search(pattern, page, re.DOTALL)[1]
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
    assert policy.startswith("default-src 'none';") and "unsafe" not in policy
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", page)


def test_an_obstacle_that_goes_far_leaves_the_robot_where_it_is() -> None:
    """Where an obstacle is kilometres away, the robot's places on the page are still within 1 mm."""
    trace = sample_trace(150, 1)
    away = Timeline.of([1], [0.5], [(np.array([0.0, 15.0]), np.array([[0.0, 9.0], [9000.0, 9.0]]))])
    far = replace(trace, timeline=away, sensed=np.zeros((151, 1), bool))
    data = data_of(replay_page(far))
    assert np.abs(places(data["robot"]["xy"], data["box"]) - far.xy).max() < 1e-3
    obstacles = places(data["obstacles"]["xy"], data["obstacles"]["box"])
    assert np.abs(obstacles - far.obstacle_xy[:, 0]).max() < 0.1


def test_the_page_holds_speed_and_distance_as_they_were() -> None:
    """On a map of a kilometre, where places are rounded to 1.5 cm, speed and the distance driven are not made of them."""
    room = Grid(np.zeros((200, 200), bool), 5.0)
    scenario = Scenario(World(room), (10.0, 10.0), (990.0, 600.0), RobotSpec(v_max=0.22, dt=0.05), horizon=5.0)
    trace = run(scenario, "follow").trace
    data = data_of(replay_page(trace, shortest=shortest(trace.task)))
    driven, speed = (np.frombuffer(base64.b64decode(data[name]), "<f4") for name in ("driven", "speed"))
    assert len(driven) == len(speed) == len(trace) + 1 and driven[0] == 0.0
    assert driven[-1] == pytest.approx(trace.length, rel=1e-5)
    assert speed == pytest.approx(np.hypot(*trace.velocity.T), rel=1e-5, abs=1e-7)


def test_the_page_holds_what_the_policy_predicted() -> None:
    """Each decision's prediction is on the page as the policy made it, whatever the obstacles did later."""
    trace = sample_trace(150, 3)
    for record, (_, decision) in zip(data_of(replay_page(trace))["decisions"], trace.decisions, strict=True):
        assert ("predicted" in record) == (decision.predicted is not None)
        if decision.predicted is not None:
            rows = np.frombuffer(base64.b64decode(record["predicted"]), "<f4").reshape(-1, 7)
            assert (rows == decision.predicted).all()


def test_the_same_trace_gives_the_same_page() -> None:
    """Two pages of one trace are equal byte for byte."""
    assert replay_page(sample_trace(40, 2)) == replay_page(sample_trace(40, 2))


def test_a_trace_of_no_steps_and_no_obstacles_makes_a_page() -> None:
    """The smallest trace, one that ends as it begins, is no special case."""
    data = data_of(replay_page(sample_trace(1, 0)))
    assert data["obstacles"]["id"] == []


def test_the_guide_names_the_keys_of_all_layers() -> None:
    """The keys that the guide gives for the layers of the replay page are as many as its layers."""
    script = (files("antway.view") / "static" / "canvas.js").read_text()
    layers = re.search(r"LAYERS = \[(.*?)\];", script, re.DOTALL)[1].strip().splitlines()
    guide = (Path(__file__).parent.parent / "docs" / "guide.md").read_text()
    assert f"`1` to `{sum('live' not in layer for layer in layers)}`\n  switch layers" in guide


def test_the_page_holds_the_distance_from_the_robots_outline() -> None:
    """The nearest distance at each step is that from its footprint, not its disc; without obstacles it is infinite."""
    footprint = ((0.6, 0.2), (0.6, -0.2), (-0.6, -0.2), (-0.6, 0.2))
    robot = RobotSpec(footprint=footprint, drive="differential", a_max=1.0)
    beside = Obstacle(0.3, Line((6.0, 3.6), (6.0, 3.6), 0.0))
    scenario = Scenario(
        World(Grid(np.zeros((60, 120), bool), 0.1), (beside,)), (1.0, 3.0), (11.0, 3.0), robot=robot, horizon=40.0
    )
    result = run(scenario, "follow")
    least = np.frombuffer(base64.b64decode(data_of(replay_page(result.trace))["clearance"]), "<f4")
    assert result.min_clearance > 0 and len(least) == len(result.trace.t)
    assert least.min() == pytest.approx(result.min_clearance, abs=0.01)
    alone = np.frombuffer(base64.b64decode(data_of(replay_page(sample_trace(5, 0)))["clearance"]), "<f4")
    assert np.isposinf(alone).all() and len(alone) == 6


BLINDNESS = {  # by Machado et al. 2009, at their full
    "none": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(colour: str) -> np.ndarray:
    """Linear red, green and blue of a colour as #rrggbb."""
    share = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIE L*a*b* of linear red, green and blue."""
    share = XYZ @ np.clip(rgb, 0.0, 1.0) / (0.9505, 1.0, 1.0888)
    f = np.where(share > 0.008856, np.cbrt(share), 7.787 * share + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_colours_are_told_apart_and_texts_read(theme: str) -> None:
    """Layers differ by more than 9 in CIE L*a*b* to any eye; text has a contrast of 4.5 to its ground, lines one of 3."""
    css = (files("antway.view") / "static" / "replay.css").read_text()
    first, second = (dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", block)) for block in css.split("}")[:2])
    colour = {name: linear(text) for name, text in ({**first, **second} if theme == "dark" else first).items()}
    layers = ("ink", "robot", "moving", "planned", "prediction", "pheromone", "braking", "field")
    for kind, seen in BLINDNESS.items():
        for one, other in combinations(layers, 2):
            far = np.linalg.norm(lab(np.array(seen) @ colour[one]) - lab(np.array(seen) @ colour[other]))
            assert far > 9.0, (kind, one, other)

    def contrast(one: str, other: str) -> float:
        dark, light = sorted(float(XYZ[1] @ colour[name]) for name in (one, other))
        return (light + 0.05) / (dark + 0.05)

    texts = [(text, graph) for text in ("ink", "quiet") for graph in ("panel", "page")]
    texts += [("good", "panel"), ("bad", "panel"), ("accent", "panel"), ("on-accent", "accent"), ("on-moving", "moving")]
    assert all(contrast(*pair) >= 4.5 for pair in (*texts, ("panel", "planned"), ("ink", "calm")))
    lines = ("robot", "moving", "planned", "pheromone", "trails", "braking", "wall", "ink")
    assert all(contrast(line, "floor") >= 3.0 for line in lines)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as one:
        yield one


@needs_browser
def test_a_person_can_play_step_scrub_and_switch(browser: Any, tmp_path: Path) -> None:
    """Play, pause, step, scrub, speed, keys, layers, zoom and theme all do what they say, without a word in the console."""
    from playwright.sync_api import expect

    trace = sample_trace(150, 3)
    file = write_replay(trace, tmp_path / "r.html", shortest=shortest(trace.task))
    page, complaints = opened(browser, file.as_uri(), OWN, **DESKTOP)
    at = expect(page.locator("#scrub")).to_have_value

    assert page.locator("#title").inner_text() == "sample" and page.locator("#outcome").inner_text() == "reached"
    page.click("#forward")
    page.click("#forward")
    page.click("#back")
    at("1")
    page.keyboard.press("End")
    at("150")
    page.keyboard.press("n")
    at("0")  # after the last encounter comes the beginning
    page.click("#next")
    at("50")
    assert page.locator("#action").inner_text() == "avoid"
    assert "Crossing from the right" in page.locator("#reason").inner_text()
    assert "pass behind" in page.locator("#facts").inner_text()
    page.locator("#scrub").fill("70")
    expect(page.locator("#time")).to_have_text("7.0 / 15.0 s")

    for layer, colour in (("trail", "robot"), ("planned", "planned")):
        before = pixels(page, colour)
        page.click(f"#layer-{layer}")
        assert pixels(page, colour) < before
        page.click(f"#layer-{layer}")
    box = page.locator("#stage").bounding_box()
    red = pixels(page, "moving")
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.wheel(0, -600)
    drawn(page)
    assert pixels(page, "robot") > 0 and pixels(page, "moving") != red
    page.keyboard.press("f")
    page.keyboard.press("T")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    page.select_option("#speed", "8")
    page.locator("#scrub").focus()
    page.keyboard.press("Home")
    page.click("#play")
    at("150")
    assert page.locator("#play").get_attribute("aria-label") == "Play", "it stops at the end"
    page.keyboard.press("1")
    assert not page.locator("#layer-global").is_checked()
    with page.expect_download() as saved:
        page.click("#save")
    assert Path(saved.value.path()).read_bytes()[:4] == b"\x89PNG"
    assert complaints == []
    page.context.close()


@needs_browser
def test_two_episodes_play_side_by_side(browser: Any, tmp_path: Path) -> None:
    """Both play at the same times, the shorter one waits at its end; the panel tells of the one chosen; zoom is shared."""
    from playwright.sync_api import expect

    one, other = sample_trace(60, 2), sample_trace(120, 3)
    object.__setattr__(other, "policy", "another")
    page, complaints = opened(browser, write_replay(one, tmp_path / "r.html", beside=[other]).as_uri(), OWN, **DESKTOP)
    announced = page.locator(".chosen")
    expect(announced).to_have_text([f"{one.policy}: {one.outcome.value}", f"another: {other.outcome.value}"])
    expect(announced.nth(0)).to_have_attribute("aria-pressed", "true")

    def pictures() -> list[str]:
        drawn(page)
        return [page.evaluate(f"document.getElementById('{name}').toDataURL()") for name in ("stage", "stage-1")]

    began = pictures()
    page.locator("#scrub").fill("30")
    expect(page.locator("#time")).to_have_text("3.0 / 12.0 s")
    later = pictures()
    assert all(a != b for a, b in zip(began, later))
    announced.nth(1).click()
    expect(announced.nth(1)).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#subtitle")).to_contain_text("policy another")
    page.locator("#scrub").fill("60")
    first = pictures()
    page.keyboard.press("End")
    expect(page.locator("#time")).to_have_text("12.0 / 12.0 s")
    last = pictures()
    assert last[0] == first[0] and last[1] != first[1], "who has arrived stays where it is"

    box = page.locator("#stage").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.wheel(0, -600)
    assert all(a != b for a, b in zip(last, pictures()))
    page.click("#fit")
    assert pictures() == last
    page.click("#layer-trail")
    assert all(a != b for a, b in zip(last, pictures()))
    page.keyboard.press("Home")
    page.select_option("#speed", "8")
    page.click("#play")
    expect(page.locator("#scrub")).to_have_value("120")
    with page.expect_download() as saved:
        page.click("#save")
    assert Path(saved.value.path()).read_bytes()[:4] == b"\x89PNG" and complaints == []
    page.context.close()

    page, complaints = opened(browser, (tmp_path / "r.html").as_uri(), OWN, **PHONE)
    fits(page, PHONE)
    sizes = [page.locator(f"#{name}").bounding_box() for name in ("stage", "stage-1")]
    assert sizes[0]["height"] == sizes[1]["height"] and sizes[0]["width"] == sizes[1]["width"] and complaints == []
    page.context.close()


@needs_browser
def test_names_are_text_and_never_markup(browser: Any, tmp_path: Path) -> None:
    """C41: 30 hostile scenario names and reasons are shown as they are, run nothing and ask the network for nothing."""
    from playwright.sync_api import expect

    trace = sample_trace(60, 1, " ".join(NASTY))
    object.__setattr__(trace, "decisions", tuple((k, Decision("avoid", text, encounter=text)) for k, text in enumerate(NASTY)))
    page, complaints = opened(browser, write_replay(trace, tmp_path / "r.html").as_uri(), OWN, **DESKTOP)
    assert page.locator("#title").text_content() == " ".join(NASTY)
    for k, text in enumerate(NASTY):
        page.locator("#scrub").fill(str(k))
        expect(page.locator("#reason")).to_have_js_property("textContent", text)
    assert page.evaluate("window.hit") is None and complaints == []
    assert page.locator("iframe, object, embed, base, img, a").count() == 0
    page.context.close()


@needs_browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("screen", [DESKTOP, PHONE, ON_ITS_SIDE], ids=["desktop", "phone", "on its side"])
def test_the_page_fits_the_screen(browser: Any, tmp_path: Path, screen: dict[str, Any], scheme: str) -> None:
    """On a desktop and on a phone nothing runs off the side, buttons are large enough, and every control has a name."""
    trace = sample_trace(60, 2)
    page, complaints = opened(browser, write_replay(trace, tmp_path / "r.html").as_uri(), OWN, color_scheme=scheme, **screen)
    fits(page, screen)
    assert page.evaluate("document.documentElement.dataset.theme") == scheme
    ink, paper = ("#1b1f24", "#ffffff") if scheme == "light" else ("#e9ecf0", "#1d2127")
    css = "getComputedStyle(document.documentElement).getPropertyValue"
    assert page.evaluate(f"{css}('--ink').trim()") == ink and page.evaluate(f"{css}('--panel').trim()") == paper
    assert pixels(page, "robot") > 20 and pixels(page, "wall") > 100 and complaints == []
    page.context.close()
