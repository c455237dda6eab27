"""The live page in headless Chromium: pictures drawn a second, time to draw one, and bytes of a frame.

Run as `python benchmarks/page.py [--seconds S]`: 200 x 200 cells, 20 obstacles, all layers, one policy and two side by side.
Prints a table and writes it to benchmarks/out/page.json.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import expect

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from antway import Grid, RobotSpec, Scenario, World
from antway.world.motions import Bounce
from antway.world.scenario import save_scenario
from antway.world.world import Obstacle
from browser import DESKTOP, chromium
from report import show, write
from serving import TOKEN, served

# Counts pictures: each begins by clearing its stage; from the first one's beginning until the script yields is their time.
COUNT = """
  window.drawn = { pictures: 0, ms: 0 };
  let begun = null;
  const clear = CanvasRenderingContext2D.prototype.clearRect;
  CanvasRenderingContext2D.prototype.clearRect = function (...box) {
    if (this.canvas.classList.contains("stage")) {
      window.drawn.pictures++;
      if (begun === null) {
        begun = performance.now();
        queueMicrotask(() => ((window.drawn.ms += performance.now() - begun), (begun = null)));
      }
    }
    return clear.apply(this, box);
  };
"""


def place() -> Scenario:
    """200 x 200 cells of 0.25 m, walls strewn, 20 obstacles that all come into sight."""
    rng = np.random.default_rng(3)
    blocked = np.zeros((200, 200), dtype=bool)
    for _ in range(60):
        row, col = rng.integers(10, 180, size=2)
        blocked[row : row + rng.integers(2, 9), col : col + rng.integers(2, 9)] = True
    blocked[:8, :8] = blocked[-8:, -8:] = False
    grid = Grid(blocked, 0.25)
    room = grid.inflate(0.6)
    obstacles: list[Obstacle] = []
    while len(obstacles) < 20:
        xy = rng.uniform(5.0, 45.0, size=2)
        if room.is_free(room.cell_at(xy)):
            obstacles.append(Obstacle(0.4, Bounce((float(xy[0]), float(xy[1])), 0.8, float(rng.uniform(-3.1, 3.1)))))
    robot = RobotSpec(radius=0.3, v_max=1.2, a_max=2.0, sensor_range=50.0)
    return Scenario(
        World(grid, tuple(obstacles)), start=(1.0, 1.0), goal=(49.0, 49.0), robot=robot, horizon=120.0, name="large"
    )


def measure(browser: object, address: str, folder: Path, seconds: float, views: int, speed: str) -> dict[str, float]:
    page = browser.new_context(**DESKTOP).new_page()  # type: ignore[attr-defined]
    sizes: list[int] = []
    page.on(
        "websocket",
        lambda wire: wire.on("framereceived", lambda text: sizes.append(len(text)) if '"frame"' in text[:20] else 0),
    )
    page.add_init_script(COUNT)
    page.goto(address)
    page.wait_for_selector("body[data-ready=true]")
    page.set_input_files("#files", sorted(folder.iterdir()))
    expect(page.locator("#scene option:checked")).to_have_text("large", timeout=60_000)
    if views == 2:
        page.click("#compare")
        expect(page.locator(".view")).to_have_count(2, timeout=60_000)
    page.keyboard.press("0")
    page.select_option("#speed", speed)
    page.click("#play")
    expect(page.locator("#time")).not_to_have_text("0.0 s", timeout=60_000)
    before = page.evaluate("() => [performance.now(), window.drawn.pictures, window.drawn.ms]")
    sizes.clear()
    page.evaluate(f"() => new Promise((done) => setTimeout(done, {1000 * seconds}))")
    after = page.evaluate("() => [performance.now(), window.drawn.pictures, window.drawn.ms]")
    span, pictures, ms = (b - a for a, b in zip(before, after))
    page.context.close()
    return {
        "views": views,
        "pictures a second": round(pictures / views / span * 1000, 1),
        "ms a picture": round(ms / pictures, 2),
        "frames a second": round(len(sizes) / span * 1000, 1),
        "bytes a frame, mean": round(float(np.mean(sizes))),
        "bytes a frame, most": max(sizes),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory() as name, served() as port, chromium() as browser:
        save_scenario(place(), Path(name) / "large.toml")
        rows = [
            measure(browser, f"http://127.0.0.1:{port}/?token={TOKEN}", Path(name), seconds, views, "2") for views in (1, 2)
        ]
    show(rows)
    write("page.json", rows)


if __name__ == "__main__":
    main()
