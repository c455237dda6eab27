"""Shortest paths and distance fields beside the Python packages that offer them, in one run.

Run as `python benchmarks/search.py [--queries N] [--seconds S] [--out FILE]`, on generated maps, and on the MovingAI maps where
they are found at ../shared/data/movingai. Peers that are not installed are left out (`pip install antway[peers]` gets them).
Each query is timed best of three in CPU time of its thread; a ratio is an engine's time over that of antway's `jps` on the same
queries (its field over antway's field), and a peer that has used up `--seconds` on a map is judged by what it did till then.
`subgoals` is antway's planner for maps that are asked often: how long it prepares a map is shown beside, and not in its ratio.
Every length is compared with the exact one, no corner cutting; a share of wrong answers is shown. A second table says how many
times as fast as nano-astar antway's planners are.
"""

from __future__ import annotations

import argparse
import importlib
import math
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from antway import Grid, Problem, distance_field, load_map
from antway.maps.movingai import load_scen
from antway.search.astar import astar
from antway.search.jps import jps
from antway.search.subgoals import prepare, subgoals
from report import DATA, OUT, write

MOVINGAI = DATA / "movingai"
Cell = tuple[int, int]
Query = Callable[[Cell, Cell], float]  # start, goal -> length in cells


def generated(side: int = 512) -> dict[str, Grid]:
    """Scattered cells, blocks, a floor of rooms, and a maze, `side` cells a side."""
    rng = np.random.default_rng(0)
    blocks, rooms, maze = (np.zeros((side, side), dtype=bool) for _ in range(3))
    for r, c in rng.integers(0, side - 32, (side * side // 900, 2)):
        blocks[r : r + rng.integers(4, 32), c : c + rng.integers(4, 32)] = True
    for part, size in ((rooms, 32), (maze, 8)):
        part[::size] = part[:, ::size] = True
        for r in range(0, side, size):
            for c in range(0, side, size):
                at = rng.integers(1, size - 3, 2)
                part[r, c + at[0] : c + at[0] + 3] = part[r + at[1] : r + at[1] + 3, c] = False
    return {
        "open": Grid(np.zeros((side, side), dtype=bool)),
        "scattered 20 %": Grid(rng.random((side, side)) < 0.2),
        "blocks": Grid(blocks),
        "rooms": Grid(rooms),
        "small rooms": Grid(maze),
    }


def queries(name: str, grid: Grid, count: int) -> list[tuple[Cell, Cell]]:
    """`count` rows spread over the scenario where there is one, else random free cells that have a path."""
    scenario = MOVINGAI / f"{name}.map.scen"
    if scenario.exists():
        rows = load_scen(scenario)
        return [(row.start, row.goal) for row in rows[:: max(1, len(rows) // count)]]
    rng = np.random.default_rng(1)
    free = np.argwhere(~grid.blocked)
    found: list[tuple[Cell, Cell]] = []
    while len(found) < count:
        a, b = (tuple(map(int, free[i])) for i in rng.integers(len(free), size=2))
        if math.isfinite(jps(Problem(grid, a, b)).length):
            found.append((a, b))
    return found


def with_diagonals(path: np.ndarray | list[tuple[int, int]]) -> float:
    """Length of a path of cells."""
    return float(np.hypot(*np.diff(np.asarray(path), axis=0).T).sum())


def nano_astar(grid: Grid) -> Query:
    module = importlib.import_module("nano_astar")
    occupied = grid.blocked.astype(np.uint8)
    return lambda a, b: module.astar(occupied, a, b)[1]


def pyastar2d(grid: Grid) -> Query:
    module = importlib.import_module("pyastar2d")
    weights = np.where(grid.blocked, np.inf, 1).astype(np.float32)
    return lambda a, b: with_diagonals(module.astar_path(weights, a, b, allow_diagonal=True))


def tcod(grid: Grid) -> Query:
    path = importlib.import_module("tcod.path")
    graph = path.SimpleGraph(cost=(~grid.blocked).astype(np.int8), cardinal=70, diagonal=99)

    def query(a: Cell, b: Cell) -> float:
        finder = path.Pathfinder(graph)
        finder.add_root(a)
        return with_diagonals(finder.path_to(b))

    return query


def scikit_image(grid: Grid) -> Query:
    graph = importlib.import_module("skimage.graph")
    weights = np.where(grid.blocked, -1.0, 1.0)
    return lambda a, b: with_diagonals(graph.route_through_array(weights, a, b, fully_connected=True, geometric=True)[0])


def explicit_edges(grid: Grid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Begin, end and length of every move of the map, without corner cutting."""
    rows, cols = grid.shape
    free = np.pad(~grid.blocked, 1)
    number = np.arange(rows * cols).reshape(rows, cols)
    since, end, length = [], [], []
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        there = free[1 + dr : rows + 1 + dr, 1 + dc : cols + 1 + dc]
        sides = free[1 + dr : rows + 1 + dr, 1:-1] & free[1:-1, 1 + dc : cols + 1 + dc]
        at = np.nonzero(free[1:-1, 1:-1] & there & (sides if dr and dc else True))
        since.append(number[at])
        end.append(number[at] + dr * cols + dc)
        length.append(np.full(len(at[0]), math.hypot(dr, dc)))
    return np.concatenate(since), np.concatenate(end), np.concatenate(length)


def scipy_graph(grid: Grid) -> object:
    sparse = importlib.import_module("scipy.sparse")
    since, end, length = explicit_edges(grid)
    return sparse.coo_array((length, (since, end)), shape=(grid.blocked.size, grid.blocked.size)).tocsr()


def networkx(grid: Grid) -> Query:
    module = importlib.import_module("networkx")
    graph = module.Graph()
    graph.add_weighted_edges_from(zip(*(part.tolist() for part in explicit_edges(grid))))
    cols = grid.shape[1]

    def octile(a: int, b: int) -> float:
        dr, dc = abs(a // cols - b // cols), abs(a % cols - b % cols)
        return max(dr, dc) + (math.sqrt(2) - 1) * min(dr, dc)

    def query(a: Cell, b: Cell) -> float:
        path = module.astar_path(graph, a[0] * cols + a[1], b[0] * cols + b[1], heuristic=octile)
        return with_diagonals([divmod(x, cols) for x in path])

    return query


def python_motion_planning(grid: Grid) -> Query:
    module = importlib.import_module("python_motion_planning")
    rows, cols = grid.shape
    world = module.Grid(bounds=[[0, rows], [0, cols]])
    world.type_map[grid.blocked] = module.TYPES.OBSTACLE

    def query(a: Cell, b: Cell) -> float:
        return with_diagonals(module.AStar(map_=world, start=a, goal=b).plan()[0])

    return query


PEERS = [nano_astar, pyastar2d, tcod, scikit_image, networkx, python_motion_planning]


def scipy_field(grid: Grid) -> Callable[[Cell], np.ndarray]:
    search = importlib.import_module("scipy.sparse.csgraph").dijkstra
    graph, cols = scipy_graph(grid), grid.shape[1]
    return lambda goal: search(graph, directed=False, indices=goal[0] * cols + goal[1]).reshape(grid.shape)


def scikit_image_field(grid: Grid) -> Callable[[Cell], np.ndarray]:
    mcp = importlib.import_module("skimage.graph").MCP_Geometric
    weights = np.where(grid.blocked, -1.0, 1.0)
    return lambda goal: mcp(weights).find_costs([goal])[0]


def tcod_field(grid: Grid) -> Callable[[Cell], np.ndarray]:
    path = importlib.import_module("tcod.path")
    cost = (~grid.blocked).astype(np.int8)

    def field(goal: Cell) -> np.ndarray:
        distance = path.maxarray(grid.shape, dtype=np.int32)
        distance[goal] = 0
        return path.dijkstra2d(distance, cost, 70, 99, out=distance)

    return field


FIELDS = [scipy_field, scikit_image_field, tcod_field]


def timed(call: Callable[[], object], repeats: int = 3) -> tuple[float, object]:
    """Best CPU time of a call in s, and its answer; a call of more than 50 ms is made once."""
    best, answer = math.inf, None
    for _ in range(repeats):
        started = time.thread_time()
        answer = call()
        best = min(best, time.thread_time() - started)
        if best > 0.05:
            break
    return best, answer


def available(makers: list, grid: Grid) -> dict[str, Callable]:
    """Those of `makers` whose package is installed, by name, made for `grid`."""
    made = {}
    for maker in makers:
        try:
            made[maker.__name__.removesuffix("_field")] = maker(grid)
        except ImportError as error:
            print(f"  without {maker.__name__}: {error}")
    return made


def measure(name: str, grid: Grid, count: int, seconds: float) -> dict[str, object]:
    """Times in microseconds and ratios on one map."""
    ends = queries(name, grid, count)
    jps(Problem(grid, *ends[0]))
    started = time.thread_time()
    jps(Problem(fresh := Grid(grid.blocked), *ends[-1]))
    first = time.thread_time() - started
    own = [timed(lambda a=a, b=b: jps(Problem(fresh, a, b))) for a, b in ends]
    exact = [plan.length for _, plan in own]
    times = np.array([t for t, _ in own])
    result: dict[str, object] = {"queries": len(ends), "jps us": times.mean() * 1e6, "first query us": first * 1e6}
    started = time.thread_time()
    result["prepared"] = prepare(fresh)
    result["prepare ms"] = (time.thread_time() - started) * 1e3
    antway = {"subgoals": subgoals, "astar": astar}
    engines = {name: lambda a, b, p=p: p(Problem(fresh, a, b)).length for name, p in antway.items()} | available(PEERS, grid)
    result["paths"] = {engine: _beside(times, exact, query, ends, seconds) for engine, query in engines.items()}
    goal = ends[len(ends) // 2][1]
    base, field = timed(lambda: distance_field(fresh, goal), 5)
    result["field ns a cell"] = base / np.isfinite(field).sum() * 1e9
    result["fields"] = {engine: timed(lambda f=f: f(goal))[0] / base for engine, f in available(FIELDS, grid).items()}
    return result


def _beside(times: np.ndarray, exact: list[float], query: Query, ends: list, seconds: float) -> dict[str, float]:
    took, wrong = [], 0
    for i in np.random.default_rng(0).permutation(len(ends)).tolist():
        t, length = timed(lambda i=i: query(*ends[i]))
        took.append((i, t))
        wrong += not math.isclose(float(length), exact[i], rel_tol=1e-5)
        if sum(t for _, t in took) > seconds:
            break
    done = [i for i, _ in took]
    mean = float(np.mean([t for _, t in took]))
    return {"us": mean * 1e6, "ratio": mean / float(times[done].mean()), "wrong": wrong / len(took)}


def main() -> None:
    """Measure, print the table, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--queries", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=2.0, help="CPU time for each peer on each map")
    parser.add_argument("--out", type=Path, default=OUT / "search.json")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    for name in ("small rooms", "open"):  # compiles what either kind of map needs
        measure("compile", generated(64)[name], 2, 0.0)
    maps = generated() | {path.stem: load_map(path) for path in sorted(MOVINGAI.glob("*.map"))}
    results = {}
    for name, grid in maps.items():
        print(name, flush=True)
        results[name] = measure(name, grid, args.queries, args.seconds)
    summary = show(results) | show_nano(results)
    write(args.out, {"maps": results, "geometric means": summary})


def show(results: dict[str, dict]) -> dict[str, float]:
    """Print the ratios of all maps and engines; return their geometric means, over all maps and over the MovingAI ones."""
    engines = list(dict.fromkeys(engine for r in results.values() for engine in r["paths"]))
    fields = list(dict.fromkeys(engine for r in results.values() for engine in r["fields"]))
    table = Table(title="Times over those of antway's jps and distance_field on the same queries (* wrong lengths)")
    for head in ("map", "jps us", *engines, "field ns/cell", *(f"{f} field" for f in fields)):
        table.add_column(head, justify="left" if head == "map" else "right")
    for name, r in results.items():
        paths = [f"{p['ratio']:.1f}{'*' if p['wrong'] else ''}" if (p := r["paths"].get(e)) else "-" for e in engines]
        table.add_row(
            name, f"{r['jps us']:.0f}", *paths, f"{r['field ns a cell']:.1f}", *(f"{r['fields'][f]:.1f}" for f in fields)
        )
    means = {}
    for title, names in (("all", list(results)), ("movingai", [n for n in results if (MOVINGAI / f"{n}.map").exists()])):
        if names:
            for e in engines:
                means[f"{title}: {e}"] = _mean([results[n]["paths"][e]["ratio"] for n in names])
            for f in fields:
                means[f"{title}: {f} field"] = _mean([results[n]["fields"][f] for n in names])
            cells = [f"{means[f'{title}: {e}']:.1f}" for e in engines], [f"{means[f'{title}: {f} field']:.1f}" for f in fields]
            table.add_row(f"geometric mean, {title}", "", *cells[0], "", *cells[1])
    Console(width=200).print(table)
    return means


def show_nano(results: dict[str, dict]) -> dict[str, float]:
    """Print how many times as fast as nano-astar antway's planners are; return the geometric means over the MovingAI maps."""
    known = {name: r for name, r in results.items() if "nano_astar" in r["paths"] and (MOVINGAI / f"{name}.map").exists()}
    if not known:
        return {}
    table = Table(title="Times as fast as nano-astar, path included, one call of Python a query")
    for head in ("map", "nano-astar us", "astar", "jps", "subgoals", "prepare ms"):
        table.add_column(head, justify="left" if head == "map" else "right")
    ratios: dict[str, list[float]] = {"astar": [], "jps": [], "subgoals": []}
    for name, r in known.items():
        nano = r["paths"]["nano_astar"]["ratio"]
        for planner, all_ratios in ratios.items():
            all_ratios.append(nano / r["paths"][planner]["ratio"] if planner != "jps" else nano)
        cells = [f"{all_ratios[-1]:.1f}" for all_ratios in ratios.values()]
        prepare_ms = f"{r['prepare ms']:.0f}" + ("" if r["prepared"] else " (does not pay)")
        table.add_row(name, f"{nano * r['jps us']:.0f}", *cells, prepare_ms)
    means = {f"nano-astar / {planner}": _mean(all_ratios) for planner, all_ratios in ratios.items()}
    table.add_row("geometric mean", "", *(f"{mean:.1f}" for mean in means.values()), "")
    Console(width=200).print(table)
    return means


def _mean(ratios: list[float]) -> float:
    return math.exp(sum(math.log(r) for r in ratios) / len(ratios))


if __name__ == "__main__":
    main()
