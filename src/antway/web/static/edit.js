// The tools that edit the scenario: each gesture on a stage becomes one request to the server.
// `page` gives: scene, tool, brush, size and pace of a new obstacle, request(message), obstacleAt(view, [x, y], within) -> index or
// -1, setDone(shown), notice(text), redraw(). A gesture lasts from press to release; one of waypoints lasts from the first to the
// last of them.
import { pointOn } from "/common.js";

const GRAB = 16; // pixels of the page; a press this near to start or goal takes hold of it
const mm = (xy) => xy.map((v) => Math.round(1000 * v) / 1000); // places to the millimetre, as people read them
const STILL = 3; // pixels of the page; a press that moves no farther is no drag
const RUNS = 25_000; // limit of runs of cells in a request; the server takes 512 KiB
const FULL = 90; // pixels of the page; length of the arrow of the fastest obstacle

class Editor {
  constructor(page) {
    this.page = page;
    this.gesture = null;
    this.cursor = null; // {view, cell: [row, col]}: the cell that the keyboard points at
  }

  // Handle the gestures on a view's stage that belong to the present tool; all others pan and zoom.
  listen(view) {
    const { canvas } = view.stage;
    const at = (event) => pointOn(canvas, event);
    canvas.addEventListener("pointerdown", (event) => {
      this.cursor = null;
      if (this.page.tool === "waypoints" && event.button === 0) return event.stopImmediatePropagation(), this.waypoint(view, at(event));
      if (this.gesture && this.gesture.pointer !== event.pointerId) return this.drop(); // a second finger: pan or zoom
      if (event.button !== 0) return;
      const gesture = this.start(view, at(event));
      if (!gesture) return;
      this.gesture = { ...gesture, view, pointer: event.pointerId };
      canvas.setPointerCapture(event.pointerId);
      event.stopImmediatePropagation();
      this.page.redraw();
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.gesture?.kind === "waypoints") return (this.gesture.xy = view.stage.toWorld(...at(event))), this.page.redraw();
      if (this.gesture?.pointer !== event.pointerId) return;
      event.stopImmediatePropagation();
      for (const each of event.getCoalescedEvents?.() ?? [event]) this.move(at(each));
      this.move(at(event));
      this.page.redraw();
    });
    canvas.addEventListener("pointerup", (event) => {
      if (this.gesture && this.gesture.pointer === event.pointerId) this.end();
    });
    canvas.addEventListener("pointercancel", () => this.drop());
    canvas.addEventListener("keydown", (event) => this.key(view, event));
    canvas.addEventListener("blur", () => ((this.cursor = null), this.page.redraw()));
  }

  drop() {
    if (this.gesture?.kind === "waypoints") this.page.setDone(false);
    this.gesture = null;
    this.page.redraw();
  }

  // The arrow keys move the cursor, Enter applies the tool there; the hand puts the goal there, and the start with Shift.
  key(view, event) {
    const step = { ArrowUp: [view.stage.up, 0], ArrowDown: [-view.stage.up, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
    if (event.ctrlKey || event.altKey || event.metaKey || !(step || (event.key === "Enter" && this.cursor))) return;
    event.preventDefault();
    event.stopPropagation();
    const { page } = this;
    const { rows, cols, resolution, x, y } = page.scene.map;
    const [row, col] = this.cursor?.cell ?? [1, 0].map((k) => Math.floor((page.scene.start[k] - [x, y][k]) / resolution));
    const centre = [x + (col + 0.5) * resolution, y + (row + 0.5) * resolution];
    if (step) this.cursor = { view, cell: [Math.min(rows - 1, Math.max(0, row + step[0])), Math.min(cols - 1, Math.max(0, col + step[1]))] };
    else if (page.tool === "hand") page.request({ op: "move", end: event.shiftKey ? "start" : "goal", xy: mm(centre) });
    else if (page.tool === "waypoints") this.waypoint(view, null, centre);
    else {
      this.gesture = { ...this.start(view, null, centre), view };
      this.end();
    }
    page.redraw();
  }

  // Add a waypoint where the map is free; a press on the first or the last one ends the sequence.
  waypoint(view, point, xy = view.stage.toWorld(...point)) {
    const { gesture, page } = this;
    page.notice(view.stage.isFree(xy) ? "" : "A waypoint must be where the map is free.");
    if (!view.stage.isFree(xy)) return;
    if (gesture?.kind !== "waypoints") {
      this.gesture = { kind: "waypoints", view, points: [xy], xy };
      page.setDone(true);
    } else {
      const within = (GRAB * view.stage.unit) / view.stage.scale;
      const again = [gesture.points[0], gesture.points.at(-1)].some(([x, y]) => Math.hypot(x - xy[0], y - xy[1]) <= within / 2);
      if (again && gesture.points.length > 1) return this.finish();
      if (!again) gesture.points.push(xy);
    }
    page.redraw();
  }

  finish() {
    const { gesture, page } = this;
    if (gesture?.kind !== "waypoints") return;
    if (gesture.points.length > 1) page.request({ op: "drop", points: gesture.points.map(mm), speed: page.pace, radius: page.size });
    this.drop();
  }

  start(view, point, xy = view.stage.toWorld(...point)) {
    const { page } = this;
    const within = (GRAB * view.stage.unit) / view.stage.scale;
    if (page.tool === "hand") {
      const near = (end) => Math.hypot(end[0] - xy[0], end[1] - xy[1]);
      const end = near(page.scene.goal) <= near(page.scene.start) ? "goal" : "start";
      const own = Math.max(within, end === "goal" ? page.scene.tolerance : page.scene.radius);
      const offset = [0, 1].map((k) => page.scene[end][k] - xy[k]); // so that it does not jump to the pointer
      return near(page.scene[end]) <= own ? { kind: "end", end, xy: page.scene[end], offset, from: point, dragged: false } : null;
    }
    if (page.tool === "stop") return { kind: "stop", xy };
    if (page.tool === "obstacle") return { kind: "obstacle", xy, from: point, velocity: [0, 0] };
    if (page.tool === "erase") {
      const obstacle = page.obstacleAt(view, xy, within / 2);
      if (obstacle >= 0) return { kind: "remove", obstacle };
    }
    const gesture = { kind: "paint", blocked: page.tool === "wall", cells: new Map(), last: null };
    this.stroke(gesture, xy);
    return gesture;
  }

  move(point) {
    const { gesture, page } = this;
    const xy = gesture.view.stage.toWorld(...point);
    if (gesture.kind === "end") {
      gesture.dragged ||= Math.hypot(point[0] - gesture.from[0], point[1] - gesture.from[1]) > STILL;
      if (gesture.dragged) gesture.xy = [0, 1].map((k) => xy[k] + gesture.offset[k]);
    }
    if (gesture.kind === "paint") this.stroke(gesture, xy);
    if (gesture.kind === "obstacle") {
      const [dx, dy] = [point[0] - gesture.from[0], gesture.view.stage.up * (gesture.from[1] - point[1])];
      const far = Math.hypot(dx, dy);
      const speed = far < 6 ? 0 : Math.min(1, far / FULL) * page.scene.fastest;
      gesture.velocity = far ? [(dx / far) * speed, (dy / far) * speed] : [0, 0];
    }
  }

  end() {
    const { gesture, page } = this;
    this.gesture = null;
    const { kind, end, xy, dragged, velocity, obstacle, blocked, cells } = gesture;
    if (kind === "stop") page.request({ op: "stop", xy: mm(xy) });
    if (kind === "end" && dragged) page.request({ op: "move", end, xy: mm(xy) });
    if (kind === "obstacle") page.request({ op: "drop", xy: mm(xy), velocity: velocity.map((v) => Math.trunc(1000 * v) / 1000), radius: page.size });
    if (kind === "remove") page.request({ op: "remove", obstacle });
    if (kind === "paint" && cells.size) {
      const runs = runsOf(cells);
      for (let i = 0; i < runs.length; i += RUNS) page.request({ op: "paint", blocked, runs: runs.slice(i, i + RUNS) });
      page.pending = { view: null, kind, blocked, cells }; // shown until the server answers
    }
    page.redraw();
  }

  // Mark the cells under the brush from the last point to this one.
  stroke(gesture, xy) {
    const { rows, cols, resolution, x, y } = this.page.scene.map;
    const here = [(xy[1] - y) / resolution, (xy[0] - x) / resolution];
    const from = gesture.last ?? here;
    const steps = Math.max(1, Math.ceil(2 * Math.hypot(here[0] - from[0], here[1] - from[1])));
    const half = (this.page.brush - 1) / 2;
    for (let i = 0; i <= steps; i++) {
      const [r, c] = [0, 1].map((k) => Math.floor(from[k] + ((here[k] - from[k]) * i) / steps));
      for (let row = r - half; row <= r + half; row++)
        for (let col = c - half; col <= c + half; col++)
          if (row >= 0 && col >= 0 && row < rows && col < cols) gesture.cells.set(row * cols + col, [row, col]);
    }
    gesture.last = here;
  }

  // Draw over the stage what the present gesture will do and the cell that the keyboard points at.
  draw(stage, gesture) {
    if (gesture?.kind === "paint") this.drawCells(stage, gesture);
    if (gesture?.kind === "obstacle") this.drawThrow(stage, gesture);
    if (gesture?.kind === "waypoints") this.drawWaypoints(stage, gesture);
    if (this.cursor?.view.stage !== stage) return;
    const c = stage.context;
    c.beginPath();
    c.rect(...stage.boxOf(...this.cursor.cell, 1, 1));
    stage.stroke(stage.colour.floor, 5);
    stage.stroke(stage.colour.ink, 2.5);
  }

  drawCells(stage, { blocked, cells }) {
    stage.context.fillStyle = blocked ? stage.colour.wall : stage.colour.floor;
    for (const [row, col] of cells.values()) {
      const [left, top, width, height] = stage.boxOf(row, col, 1, 1);
      stage.context.fillRect(left, top, width + 0.5, height + 0.5);
    }
  }

  drawWaypoints(stage, { points, xy }) {
    stage.line([...points, xy, points[0]], stage.colour.moving, 1.5, [5, 4]);
    for (const point of points) stage.disc(stage.toScreen(point), 5 * stage.unit, stage.colour.floor, stage.colour.moving, 2);
    stage.drawObstacle({ id: "", x: points[0][0], y: points[0][1], radius: this.page.size, sensed: true, focus: true });
  }

  drawThrow(stage, { xy, velocity }) {
    const c = stage.context;
    stage.drawObstacle({ id: "", x: xy[0], y: xy[1], radius: this.page.size, sensed: true, focus: true });
    const speed = Math.hypot(...velocity);
    const [sx, sy] = stage.toScreen(xy);
    const far = (FULL * stage.unit) / this.page.scene.fastest;
    const [ex, ey] = [sx + velocity[0] * far, sy - stage.up * velocity[1] * far];
    c.beginPath();
    c.moveTo(sx, sy);
    c.lineTo(ex, ey);
    const angle = Math.atan2(ey - sy, ex - sx);
    if (speed) for (const side of [-0.5, 0.5]) {
      c.moveTo(ex, ey);
      c.lineTo(ex - 12 * stage.unit * Math.cos(angle + side), ey - 12 * stage.unit * Math.sin(angle + side));
    }
    stage.stroke(stage.colour.ink, 2.5);
    c.fillStyle = stage.colour.ink;
    c.font = `600 ${13 * stage.unit}px system-ui, sans-serif`;
    c.textAlign = "left";
    c.textBaseline = "bottom";
    c.fillText(speed ? `${speed.toFixed(2)} m/s` : "stands", sx + 14 * stage.unit, sy - 14 * stage.unit);
  }
}

// Cells as runs [row, first column, last column].
function runsOf(cells) {
  const runs = [];
  for (const [row, col] of [...cells.values()].sort((a, b) => a[0] - b[0] || a[1] - b[1])) {
    const last = runs.at(-1);
    if (last?.[0] === row && last[2] === col - 1) last[2] = col;
    else runs.push([row, col, col]);
  }
  return runs;
}

export { Editor };
