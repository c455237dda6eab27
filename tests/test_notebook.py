"""Records show themselves: one short line, a picture in a notebook, a page, a table."""

from __future__ import annotations

import base64
import io
import re
import sys

import pytest
from PIL import Image

import antway
from antway.view.notebook import Page


@pytest.fixture(scope="module")
def records():
    grid = antway.load_map("office")
    plan = antway.plan(grid, (1.5, 3.0), (22.0, 12.5), robot_radius=0.25)
    tour = antway.plan_tour(grid, (1.5, 3.0), [(22.0, 12.5), (1.5, 12.5)], robot_radius=0.25, seconds=0.1)
    return {"grid": grid, "plan": plan, "tour": tour, "episode": antway.run(antway.load_scenario("paper"), "follow", seed=1)}


@pytest.mark.parametrize("name", ["grid", "plan", "tour", "episode"])
def test_a_record_is_one_line_and_a_picture(records, name):
    """`repr` is short and names what matters; a notebook gets the same words and a picture of some size."""
    words, shown = repr(records[name]), records[name]._repr_html_()
    assert len(words) < 120 and "\n" not in words and "array" not in words
    data = base64.b64decode(re.search(r"base64,([^\"]+)", shown)[1])
    picture = Image.open(io.BytesIO(data))
    assert picture.width > 300 and len(picture.convert("RGB").getcolors(2**20)) > 10


def test_words(records):
    """The words hold the numbers."""
    assert repr(records["grid"]) == "Grid(150 x 240 cells of 0.1 m, 18 % blocked)" or "cells of 0.1 m" in repr(records["grid"])
    plan = records["plan"]
    assert repr(plan) == f"Plan(found, {plan.length:.3f} m, {len(plan.cells)} cells, optimal)"
    assert repr(antway.Plan(antway.Status.NO_PATH)) == "Plan(no-path)"


def test_a_plan_draws_itself(records, tmp_path):
    """`plan.plot()` draws on the map that the plan was asked about, or on another, and writes files."""
    records["plan"].plot(out=tmp_path / "plan.png")
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")
    assert records["plan"].plot(records["grid"]).axes
    with pytest.raises(antway.BadParameter, match="grid"):
        antway.Plan(antway.Status.NO_PATH).plot()
    with pytest.raises(antway.BadParameter, match="out"):
        records["plan"].plot(out=tmp_path / "plan.bmp")


def test_show(records, monkeypatch):
    """Outside notebooks `show` opens the browser on a file; in one, an episode is a replay page in a frame."""
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    page = antway.show(records["episode"])
    assert isinstance(page, Page) and "<!doctype html>" in page.text and opened[0].startswith("file:")
    antway.show(records["plan"], browser=False)
    assert len(opened) == 1
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    assert "<iframe" in antway.show(records["episode"])._repr_html_() and "<img" in antway.show(records["tour"]).text
    assert len(opened) == 1
    with pytest.raises(antway.BadParameter, match="record"):
        antway.show(3)


def test_tables(records):
    """Episodes, plans, tours and rows become data frames with a row for each step, cell, visit and row."""
    pytest.importorskip("pandas")
    episode = records["episode"]
    frame = antway.to_dataframe(episode)
    assert len(frame) == len(episode.trace) and frame["t"].iloc[-1] == episode.trace.t[-2]
    assert list(antway.to_dataframe(records["plan"]).columns) == ["row", "col", "x", "y"]
    assert antway.to_dataframe(records["tour"])["leg"].sum() == pytest.approx(records["tour"].length)
    assert len(antway.to_dataframe([antway.Command(), antway.Command((1.0, 0.0))])) == 2
    for wrong in (3, "x", [1, 2], antway.run(antway.load_scenario("paper"), "follow", record=False)):
        with pytest.raises(antway.BadParameter, match="table"):
            antway.to_dataframe(wrong)
