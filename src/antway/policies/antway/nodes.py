"""The nodes between which policy antway plans on a map, the robot's moves between them, and the times to the goal."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from antway.errors import CellBlocked, OutOfBounds
from antway.grid import Cell, Grid, Moves
from antway.kernels.base.arrays import Bools
from antway.kernels.base.jit import call
from antway.kernels.robot.brake import DEEPEST, fits_at, fits_near
from antway.kernels.robot.sweep import enlarged
from antway.kernels.spacetime.context import PlanningContext
from antway.kernels.spacetime.moves import move_mask
from antway.planning import standing_cell
from antway.search.sipp import timed_field, timed_moves
from antway.world.line_of_sight import nearest_free, start_cell
from antway.world.policy import XY, RobotSpec, Task
from antway.world.rollouts import finite_limits
from antway.world.terrain import body_of, terrain_of, walls_of

ContextPair = tuple[PlanningContext, PlanningContext]  # between nodes that suit the robot, and between all cells

_HERE = np.zeros((1, 2), np.int32)  # a single move of length 0; read-only like all moves, so that the kernel is compiled once
_HERE.flags.writeable = False
_RADII = 6  # number of discs tried, from the one around the footprint to the one inside it
_LEAST_RADIUS = 0.1  # 1; no disc is smaller than this share of the first, because a footprint may turn about a point beside it
_FAR_CELLS = 20  # number of cells around the start and the goal among which a free one is searched for
_MOST_CELLS = 1_000_000  # limit of cells of a map after its cells are divided
_WALL_MARGIN = 0.05  # m; robots with inertia keep this from walls where they can, because ramps within a cycle cut corners
_LEAST_MARGIN = 0.016  # m; near the start and the goal they keep this, as rollouts keep 15 mm and would stop before a gap
_FINE = 0.4  # 1; such robots need cells that are no larger than this share of the radius
_SPARSE = 0.5  # 1; nodes of the plan of a robot that follows it are no farther apart than this share of the radius, or a cell
_LONGER = 1.02  # 1; paths between fewer nodes may take this times as long
_TURNED = 0.1  # rad; where a robot cannot turn but is turned by more than this, it is planned for anew
_ENDS = 1.0  # m; no wall margin is kept this near to the start and the goal, where one of them is too near to a wall


def contexts_for(task: Task, moves: Moves, heading: float) -> tuple[ContextPair, ContextPair | None]:
    """Return the contexts of `planning_contexts`, and those of `narrow_contexts`.

    With a `heading`, rad, they are for a robot that keeps its footprint in that heading; NaN stands for none. `OutOfBounds` and
    `CellBlocked` tell that the robot does not fit at the start or at the goal.
    """
    wide = planning_contexts(task, moves)
    narrow = narrow_contexts(task, moves, wide[0].radius)
    if math.isnan(heading):
        return wide, narrow
    far, kept = narrow or wide
    kept = in_heading(task, kept, heading, moves)
    turned = in_heading(task, far, heading, moves) if far.resolution > kept.resolution else kept, kept
    return turned, narrow and turned


def is_turned(robot: RobotSpec, before: float, heading: float) -> bool:
    """Tell whether a robot that cannot turn has been turned since its contexts were made for the heading `before`, rad."""
    keeps = not robot.wheels and robot.footprint is not None
    return keeps and not abs(math.remainder(heading - before, math.tau)) <= _TURNED


def in_heading(task: Task, context: PlanningContext, heading: float, moves: Moves) -> PlanningContext:
    """Return the context with those nodes alone where the footprint fits in this heading, with a margin where a path keeps it.

    If it does not fit at the node of the goal, paths end at the nearest node where it does.
    """
    c, cells = context, (context.rows, context.cols)
    x, y = c.x0 + np.arange(c.cols) * c.resolution, (c.y0 + np.arange(c.rows) * c.resolution)[:, None]
    fits = np.empty((2, *cells), np.bool_)
    for margin, found in zip((_WALL_MARGIN, 0.0), fits, strict=True):
        body = enlarged(body_of(task.robot), margin)
        call(fits_at, c.x0, c.y0, c.resolution, float(heading), body, walls_of(task.grid), found)
    to_goal, to_start = (np.hypot(x - xy[0], y - xy[1]) for xy in (task.goal, task.start))
    fits[0] |= fits[1] & (np.minimum(to_goal, to_start) <= _ENDS)
    goal = c.goal if fits[1].flat[c.goal] else int(np.where(fits[1], to_goal, math.inf).argmin())
    for found in fits:
        legal = _legal_where(found, c.legal.reshape(cells), moves)
        field = timed_field(legal, moves, divmod(goal, c.cols), scale=c.resolution / c.speed)
        context = c._replace(legal=legal.ravel(), field=field.ravel(), goal=goal)
        if math.isfinite(_time_from(context, task.grid, task.grid.cell_at(task.start))):
            break
    return context


def _legal_where(fits: Bools, legal: NDArray[np.uint32], moves: Moves) -> NDArray[np.uint32]:
    """Return the legal moves that begin where the footprint fits, and lead over no node where it does not."""
    far, (rows, cols) = int(np.abs(moves.offsets).max()), fits.shape
    around, found = np.pad(fits, far), np.where(fits, legal, np.uint32(0))
    for k, between in enumerate(moves.touched):
        for row, col in between:
            over = around[far + row : far + row + rows, far + col : far + col + cols]
            found &= np.where(over, ~np.uint32(0), ~np.uint32(1 << k))
    return found


def planning_contexts(task: Task, moves: Moves) -> ContextPair:
    """Return the planning context between nodes at distances that suit the robot, and that between all cells of the task.

    The errors are those of `planning_context`.
    """
    task, over_cells, start, goal = planning_context(task, moves)
    kept = over_cells if task.robot.stepwise else away_from_walls(task, over_cells, start, goal, moves)
    return with_far_nodes(task, over_cells, kept, start, goal, moves), kept


def narrow_contexts(task: Task, moves: Moves, radius: float) -> ContextPair | None:
    """Return the contexts of `planning_contexts` for a disc whose diameter is the smallest width of the footprint.

    None if that disc is not smaller than one of `radius` m, or does not fit at the start or at the goal.
    """
    corners = task.robot.corners
    x, y = (np.roll(corners, -1, axis=0) - corners).T
    if len(corners) == 1:
        return None
    over = x[:, None] * (corners[:, 1] - corners[:, 1, None]) - y[:, None] * (corners[:, 0] - corners[:, 0, None])
    width = float((over.max(axis=1) / np.hypot(x, y)).min())
    if 0.5 * width >= radius:
        return None
    disc = replace(task, robot=_disc(task.robot, 0.5 * width))
    try:
        return planning_contexts(disc, moves)
    except CellBlocked:
        return None


def _disc(robot: RobotSpec, radius: float) -> RobotSpec:
    """Return the robot as a disc of `radius` m; it is driven as before, so it moves stepwise only if the robot does."""
    a_max = robot.a_max if robot.stepwise else finite_limits(robot).a_max
    return replace(robot, radius=radius, footprint=None, a_max=a_max)


def planning_context(task: Task, moves: Moves) -> tuple[Task, PlanningContext, Cell, Cell]:
    """Return the task on the cells that are planned on, its planning context, and the cells at which its paths start and end.

    The cells are those of the map, or finer ones where a robot without inertia has no path between the centres of these: it
    may fit through passages that are hardly wider than two large cells.

    The context is that of the largest disc that has a path, of a few from the disc around the footprint down to the one inside
    it. A smaller disc finds the path through a door that is hardly wider than the robot, and its path leads through the middle.
    Rollouts and the guard test the footprint itself.
    `OutOfBounds` and `CellBlocked` tell that the robot does not fit at the start or at the goal.
    """
    grid, robot = task.grid, task.robot
    ends = {"start": task.start, "goal": task.goal}
    body = body_of(robot)
    if robot.footprint is not None and not call(fits_near, *task.goal, task.goal_tolerance, body, walls_of(grid)):
        raise CellBlocked("goal", task.goal, "where the robot's footprint fits between the walls in some heading")
    widest = None
    narrowest = max(robot.inscribed, _LEAST_RADIUS * robot.radius)
    for radius in dict.fromkeys(np.linspace(robot.radius, narrowest, _RADII).tolist()):
        # The same as Grid.inflate, but faster for a robot of few cells.
        stands = move_mask(grid.blocked, _HERE, radius / grid.resolution, 1, 0, 0)
        inflated = replace(grid, blocked=stands == 0)
        start, goal = (_end_cell(task, inflated, radius, name, xy) for name, xy in ends.items())
        if start is None or goal is None:
            continue
        context = make_context(grid, _disc(robot, radius), goal, moves)
        if math.isfinite(context.field[start[0] * grid.shape[1] + start[1]]):
            return task, context, start, goal
        widest = widest or (task, context, start, goal)
    fine = with_fine_cells(task) if robot.stepwise else task
    if fine is not task:
        with suppress(CellBlocked):
            found = planning_context(fine, moves)
            if math.isfinite(found[1].field.reshape(fine.grid.shape)[found[2]]):
                return found
    if widest is None:
        for name, xy in ends.items():
            standing_cell(name, xy, grid, inflated, radius)
    assert widest is not None, "standing_cell has raised the error"
    return widest


def _end_cell(task: Task, inflated: Grid, radius: float, name: str, xy: XY) -> Cell | None:
    """Return the cell of `xy` if it is free, or else the nearest free one to which the robot can drive straight, or None.

    At the start the robot's place may be in a wall, because the map or its localisation is wrong by some centimetres.
    """
    try:
        cell = inflated.cell_at(xy)
    except OutOfBounds as error:
        raise error.at("", name) from None
    if inflated.is_free(cell):
        return cell
    inscribed = task.robot.inscribed
    least, find = ((1.0 - DEEPEST) * inscribed, start_cell) if name == "start" else (inscribed, nearest_free)
    cells = min(2 + math.ceil((radius - least) / inflated.resolution), _FAR_CELLS)
    return find(task.grid, inflated, xy, cells, inscribed)


def with_fine_cells(task: Task) -> Task:
    """Return the task on the same map in cells no larger than a part of the robot, as far as they are not too many.

    Moves of 32 directions lead through cells in whose centre a robot cannot stand. If such cells are larger than the robot, a
    field that is interpolated between centres has a ridge across these moves, before which the robot would stop. Large
    cells also do not show whether a passage is slightly wider than the robot or too narrow. A passage of an odd number of cells
    has its middle between the centres of cells that are divided by an even number, which may be too near to its walls.
    """
    grid, widths = task.grid, task.robot.radius / task.grid.resolution
    most = math.isqrt(_MOST_CELLS // grid.blocked.size)
    finer = min(math.ceil(1.0 / (_FINE * widths) - 1e-9), most)
    if finer > 0 and finer % 2 == 0 and 0.5 - 0.5 / finer + 1e-9 < widths % 1.0 < 0.5 - 1e-9:
        finer += 1 if finer < most else -1
    if finer <= 1:
        return task
    cells = np.repeat(np.repeat(grid.blocked, finer, axis=0), finer, axis=1)
    return replace(task, grid=replace(grid, blocked=cells, resolution=grid.resolution / finer, unknown=None))


def with_far_nodes(
    task: Task, context: PlanningContext, kept: PlanningContext, start: Cell, goal: Cell, moves: Moves
) -> PlanningContext:
    """Return `kept`, or a context like it with fewer nodes if the cells are much smaller than the robot.

    A search tests a limited number of moves in a control cycle, so it looks farther ahead where nodes are farther apart. No
    nodes are left out if the path from the start would get longer by more than 2 %. `context` is that of `planning_context`,
    and `kept` either the same or that of `away_from_walls`.
    """
    grid, robot, margin = task.grid, _disc(task.robot, context.radius), kept is not context
    most = _time_from(kept, grid, start) * _LONGER
    for stride in range(int((_FINE if margin else _SPARSE) * context.radius / grid.resolution + 1e-9), 1, -1):
        found = make_context(grid, robot, goal, moves, stride=stride)
        if margin:
            found = away_from_walls(task, found, start, goal, moves, stride)
        if _time_from(found, grid, start) <= most:
            return found
    return kept


def _time_from(context: PlanningContext, grid: Grid, cell: Cell) -> float:
    """Return the time to the goal from a cell of the map by the best node that is no farther than a node's distance, s."""
    stride = round(context.resolution / grid.resolution)
    x, y = grid.centre(cell)
    row, col = (y - context.y0) / context.resolution, (x - context.x0) / context.resolution
    reaches = 1.0 if stride > 1 else 1e-6
    low_r, low_c = max(math.ceil(row - reaches), 0), max(math.ceil(col - reaches), 0)
    window = np.s_[low_r : math.floor(row + reaches) + 1, low_c : math.floor(col + reaches) + 1]
    near = context.field.reshape(context.rows, context.cols)[window]
    i, j = np.ogrid[: near.shape[0], : near.shape[1]]
    legs = np.hypot(i + low_r - row, j + low_c - col) * (context.resolution / context.speed)
    return float((near + legs).min(initial=math.inf))


def away_from_walls(
    task: Task, context: PlanningContext, start: Cell, goal: Cell, moves: Moves, stride: int = 1
) -> PlanningContext:
    """Return the context of `planning_context` with a margin to walls, if a path from the start to the goal keeps it.

    If there is none, because an end is too near to a wall, it is small near both ends, or left out there, or everywhere.
    """
    grid, radius = task.grid, context.radius
    first = goal[0] % stride, goal[1] % stride
    wide = timed_moves(grid, radius + _WALL_MARGIN, moves, stride, first)
    rows, cols = (np.arange(n) * stride + low for n, low in zip(wide.shape, first, strict=True))
    ends = np.zeros(wide.shape, dtype=bool)
    for row, col in (start, goal):
        ends |= np.hypot(rows[:, None] - row, cols - col) * grid.resolution <= _ENDS
    known = {_WALL_MARGIN: wide, 0.0: context.legal.reshape(wide.shape)}
    for margin in (_WALL_MARGIN, _LEAST_MARGIN, 0.0):
        near = known[margin] if margin in known else timed_moves(grid, radius + margin, moves, stride, first)
        mask = np.where(ends, near, wide)
        found = make_context(grid, _disc(task.robot, radius + margin), goal, moves, mask, stride)
        if math.isfinite(_time_from(found, grid, start)):
            return found
    return context


def make_context(
    grid: Grid,
    robot: RobotSpec,
    goal: Cell,
    moves: Moves = Moves.THIRTY_TWO,
    mask: NDArray[np.uint32] | None = None,
    stride: int = 1,
) -> PlanningContext:
    """Return the moves that the disc of `robot` can make on `grid`, and the exact field to `goal` over them.

    Moves lead from cell to cell, or between every `stride`-th cell from the goal on. With `mask`, they are those of it.
    """
    (x, y, _), size = grid.origin, stride * grid.resolution
    first = goal[0] % stride, goal[1] % stride
    mask = timed_moves(grid, robot.radius, moves, stride, first) if mask is None else mask
    rows, cols = mask.shape
    node = goal[0] // stride, goal[1] // stride
    field = timed_field(mask, moves, node, scale=size / robot.v_max)
    offsets = moves.offsets.astype(np.int64)
    return PlanningContext(
        terrain=terrain_of(grid),
        rows=rows,
        cols=cols,
        legal=mask.ravel(),
        field=field.ravel(),
        offset=offsets[:, 0] * cols + offsets[:, 1],
        step=np.column_stack((offsets[:, 1] * size, offsets[:, 0] * size, moves.lengths * (size / robot.v_max))),
        resolution=size,
        x0=x + (first[1] + 0.5) * grid.resolution,
        y0=y + (first[0] + 0.5) * grid.resolution,
        radius=robot.radius,
        speed=robot.v_max,
        goal=node[0] * cols + node[1],
    )


def on_cells(
    context: PlanningContext, grid: Grid, top: int, left: int, amounts: NDArray[np.float32]
) -> tuple[int, int, NDArray[np.float32]]:
    """Return amounts at nodes, in a window from node (top, left) on, as amounts in cells of the map, also in a window.

    A cell has the largest amount of the nodes in it, or else that of the nearest node.
    """
    (x, y, _), size, each = grid.origin, grid.resolution, context.resolution
    ends = (context.y0 - y + top * each, amounts.shape[0]), (context.x0 - x + left * each, amounts.shape[1])
    rows, cols = (((low + np.arange(n) * each) / size).astype(np.int64) for low, n in ends)
    k = round(each / size)
    if k > 1:
        amounts = amounts.repeat(k, axis=0).repeat(k, axis=1)
        rows, cols = ((at[:, None] + np.arange(k) - (k - 1) // 2).ravel() for at in (rows, cols))
        inside = [(at >= 0) & (at < side) for at, side in zip((rows, cols), grid.shape, strict=True)]
        rows, cols, amounts = rows[inside[0]], cols[inside[1]], amounts[np.ix_(*inside)]
    out = np.zeros((rows[-1] - rows[0] + 1, cols[-1] - cols[0] + 1), np.float32)
    np.maximum.at(out, np.ix_(rows - rows[0], cols - cols[0]), amounts)
    return int(rows[0]), int(cols[0]), out
