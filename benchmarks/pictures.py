"""Draw docs/images anew: the office's animation, the replay page, and how the Ant System converges. Needs Chromium.

Run as `python benchmarks/pictures.py`.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from antway.demo import write_convergence
from antway.view.animation import write_animation
from antway.view.figures import moments, shortest
from antway.view.replay import write_replay
from antway.world.episode import run
from antway.world.scenario import load_scenario
from antway.world.trace import Trace

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu"]


def shot(trace: Trace, file: Path) -> None:
    """Show the replay page in the midst of an encounter."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page_file = write_replay(trace, Path(folder) / "replay.html", shortest=shortest(trace.task))
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(page_file.as_uri())
        page.wait_for_selector("body[data-ready=true]")
        page.locator("#scrub").fill(str(moments(trace)[1]))
        page.wait_for_timeout(500)
        page.screenshot(path=file)
        browser.close()


def main() -> None:
    """Draw."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    IMAGES.mkdir(exist_ok=True)
    office = run(load_scenario("office"), "antway").trace
    paper = run(load_scenario("paper"), "paper").trace
    assert office is not None and paper is not None
    write_animation(office, IMAGES / "office.gif", shortest=shortest(office.task), width=560, frames=70)
    shot(paper, IMAGES / "replay.png")
    write_convergence(load_scenario("paper"), IMAGES / "convergence.png")


if __name__ == "__main__":
    main()
