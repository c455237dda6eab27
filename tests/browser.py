"""A headless Chromium for the tests of pages: Debian's, driven by Playwright; nothing is downloaded."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from serving import TOKEN

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine (apt-get install chromium)")
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-dev-shm-usage"]
DESKTOP: dict[str, Any] = {"viewport": {"width": 1280, "height": 720}}
PHONE: dict[str, Any] = {
    "viewport": {"width": 390, "height": 844},
    "device_scale_factor": 2,
    "has_touch": True,
    "is_mobile": True,
}
ON_ITS_SIDE: dict[str, Any] = {**PHONE, "viewport": {"width": 844, "height": 390}}

NASTY = [
    "</script><script>window.hit=1</script>",
    "<img src=x onerror=window.hit=1>",
    "<!--<script>",
    '"><svg/onload=window.hit=1>',
    "'-window.hit=1-'",
    "{{script}}",
    "\u2028window.hit=1",
    "&lt;b&gt;",
    "javascript:window.hit=1",
    "]]><script>window.hit=1</script>",
    "<script>window.hit=1</script>",
    "<body onload=window.hit=1>",
    "<iframe srcdoc='<script>parent.hit=1</script>'>",
    "<details open ontoggle=window.hit=1>",
    "<math><mi//xlink:href='javascript:window.hit=1'>",
    "<a href=javascript:window.hit=1>x</a>",
    "<style>*{background:url(https://evil.example/x)}</style>",
    "<link rel=stylesheet href=https://evil.example/x.css>",
    "<img src=https://evil.example/x.png>",
    "<object data=https://evil.example/x>",
    "<embed src=javascript:window.hit=1>",
    "<input autofocus onfocus=window.hit=1>",
    "<video><source onerror=window.hit=1></video>",
    "<svg><animate onbegin=window.hit=1 attributeName=x dur=1s>",
    "<meta http-equiv=refresh content='0;url=https://evil.example'>",
    "<base href=https://evil.example/>",
    "${window.hit=1}",
    "\\u003cscript\\u003ewindow.hit=1\\u003c/script\\u003e",
    "%3Cscript%3Ewindow.hit=1%3C/script%3E",
    "<<scr\0ipt>window.hit=1//<</script>",
]  # what must never run, by the name of C41


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser for the length of the block."""
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=30_000)  # as long as a busy machine may take
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


def opened(browser: Any, address: str, own: tuple[str, ...], **context: Any) -> tuple[Any, list[str]]:
    """A page that is ready, and all it says in the console or asks of other addresses than those that begin as `own`."""
    made = browser.new_context(**context)
    if address.startswith("http://127.0.0.1:"):  # the server's page: its cookie holds the token from here on
        made.request.get(f"{'/'.join(address.split('/')[:3])}/?token={TOKEN}")
    page = made.new_page()
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: None if request.url.startswith(own) else complaints.append(request.url))
    page.on("dialog", lambda dialog: (complaints.append(f"dialog {dialog.message}"), dialog.dismiss()))
    page.goto(address)
    page.wait_for_selector("body[data-ready=true]", timeout=60_000)
    drawn(page)
    return page, complaints


def drawn(page: Any) -> None:
    """Wait until the page has drawn what it was told: two frames of its clock."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def pixels(page: Any, colour: str, canvas: str = "canvas") -> int:
    """How many pixels of a canvas have the page's colour of that name, give or take a little, once it is drawn."""
    drawn(page)
    return int(
        page.evaluate(
            """([name, selector]) => {
              const css = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
              const [r, g, b] = [1, 3, 5].map((i) => parseInt(css.slice(i, i + 2), 16));
              const stage = document.querySelector(selector);
              const copy = document.createElement("canvas");
              [copy.width, copy.height] = [stage.width, stage.height];
              const c = copy.getContext("2d", { willReadFrequently: true });
              c.drawImage(stage, 0, 0);
              const data = c.getImageData(0, 0, stage.width, stage.height).data;
              let n = 0;
              for (let i = 0; i < data.length; i += 4)
                n += Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b) < 12;
              return n;
            }""",
            [colour, canvas],
        )
    )


def boxes(found: Any) -> list[dict[str, float] | None]:
    """The box on the screen of each element that a locator finds, asked for all at once; None for one that is not shown."""
    return found.evaluate_all(  # type: ignore[no-any-return]
        "all => all.map((e) => e.getClientRects().length ? e.getBoundingClientRect().toJSON() : null)"
    )


def fits(page: Any, screen: dict[str, Any]) -> None:
    """Assert that nothing runs off the side, that map and controls are large enough, and that each of them has a name."""
    assert page.evaluate("document.documentElement.scrollWidth") <= screen["viewport"]["width"]
    least = 44 if screen.get("is_mobile") else 32
    small = [box for box in boxes(page.locator("button:visible")) if min(box["width"], box["height"]) < least]
    assert small == []
    assert page.locator("canvas:visible").first.bounding_box()["height"] > 120
    assert page.locator("#speed").bounding_box()["width"] >= 64
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll("button, input, select, canvas, summary")]
          .filter((e) => !(e.ariaLabel || e.textContent.trim() || e.labels?.length || e.ariaHidden === "true" ||
                           e.getAttribute("aria-labelledby"))).map((e) => e.outerHTML)"""
    )
    assert unnamed == []


def expect(page: Any, selector: str) -> Any:
    from playwright.sync_api import expect

    return expect(page.locator(selector))


def point(page: Any, x: float, y: float, size: float = 20.0) -> tuple[float, float]:
    """Where on the screen the place (x, y) m of a square map of that size is."""
    box = page.locator("canvas.stage").first.bounding_box()
    scale = 0.96 * min(box["width"], box["height"]) / size
    return box["x"] + box["width"] / 2 + (x - size / 2) * scale, box["y"] + box["height"] / 2 - (y - size / 2) * scale


def drag(page: Any, *places: tuple[float, float]) -> None:
    page.mouse.move(*point(page, *places[0]))
    page.mouse.down()
    for place in places[1:]:
        page.mouse.move(*point(page, *place), steps=8)
    page.mouse.up()


def drop(page: Any, name: str, text: str) -> None:
    """Drag a file over the page and drop it there."""
    page.evaluate(
        """([name, text]) => {
          const dataTransfer = new DataTransfer();
          dataTransfer.items.add(new File([text], name));
          const main = document.querySelector("main");
          for (const kind of ["dragover", "drop"])
            main.dispatchEvent(new DragEvent(kind, { dataTransfer, bubbles: true, cancelable: true }));
        }""",
        [name, text],
    )


def saved(page: Any, what: str) -> tuple[str, bytes]:
    """Name and content of what the menu Save gives."""
    page.click(".menu summary")
    with page.expect_download(timeout=60_000) as file:
        page.click(f"#save-{what}")
    return file.value.suggested_filename, Path(file.value.path()).read_bytes()


def dead(page: Any) -> list[str]:
    """The buttons, choosers and fields of a page that nothing listens to, itself or a menu, list or form round it."""
    wire = page.context.new_cdp_session(page)
    call = """function (k) {
      const all = [...document.querySelectorAll("button, select, input:not([readonly]), summary, a")];
      return k < 0 ? all.length : all[k];
    }"""
    place = wire.send("Runtime.evaluate", {"expression": "document"})["result"]["objectId"]

    def control(k: int) -> Any:
        found = {"functionDeclaration": call, "objectId": place, "arguments": [{"value": k}]}
        return wire.send("Runtime.callFunctionOn", found)["result"]

    unheard = []
    for k in range(control(-1)["value"]):
        node = control(k)
        listeners = wire.send("DOMDebugger.getEventListeners", {"objectId": node["objectId"]})["listeners"]
        kinds = {listener["type"] for listener in listeners}
        of_itself = node["description"].startswith(("summary", "a"))  # opens what it is the summary of, leads where it says
        if not of_itself and not kinds & {"click", "change", "input"}:
            unheard.append(node["description"])
    return unheard
