// The tools that change the place: each gesture on a stage becomes one wish to the server.
// `page` gives: scene, tool, brush, wish(message), obstacleAt(lane, [x, y], reach) -> index or -1, redraw().

const GRAB = 16; // pixels of the page round start or goal
const FULL = 90; // pixels of the page for the fastest obstacle

class Editor {
  constructor(page) {
    this.page = page;
    this.gesture = null;
  }

  // Take the gestures on a lane's stage that the present tool means; what it does not take is left to pan and zoom.
  listen(lane) {
    const { canvas } = lane.stage;
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    canvas.addEventListener("pointerdown", (event) => {
      if (this.gesture && this.gesture.pointer !== event.pointerId) return this.drop(); // a second finger: pan or zoom
      if (event.button !== 0) return;
      const gesture = this.begin(lane, at(event));
      if (!gesture) return;
      this.gesture = { ...gesture, lane, pointer: event.pointerId };
      canvas.setPointerCapture(event.pointerId);
      event.stopImmediatePropagation();
      this.page.redraw();
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.gesture?.pointer !== event.pointerId) return;
      event.stopImmediatePropagation();
      for (const each of event.getCoalescedEvents?.() ?? [event]) this.move(at(each));
      this.move(at(event));
      this.page.redraw();
    });
    canvas.addEventListener("pointerup", (event) => {
      if (this.gesture?.pointer === event.pointerId) this.end();
    });
    canvas.addEventListener("pointercancel", () => this.drop());
  }

  drop() {
    this.gesture = null;
    this.page.redraw();
  }

  begin(lane, point) {
    const { page } = this;
    const xy = lane.stage.toWorld(...point);
    const reach = (GRAB * lane.stage.unit) / lane.stage.scale;
    if (page.tool === "hand") {
      const near = (end) => Math.hypot(end[0] - xy[0], end[1] - xy[1]);
      const end = near(page.scene.goal) <= near(page.scene.start) ? "goal" : "start";
      const own = Math.max(reach, end === "goal" ? page.scene.tolerance : page.scene.radius);
      return near(page.scene[end]) <= own ? { kind: "end", end, xy } : null;
    }
    if (page.tool === "obstacle") return { kind: "obstacle", xy, from: point, velocity: [0, 0] };
    if (page.tool === "erase") {
      const obstacle = page.obstacleAt(lane, xy, reach / 2);
      if (obstacle >= 0) return { kind: "remove", obstacle };
    }
    const gesture = { kind: "paint", blocked: page.tool === "wall", cells: new Map(), last: null };
    this.stroke(gesture, xy);
    return gesture;
  }

  move(point) {
    const { gesture, page } = this;
    const xy = gesture.lane.stage.toWorld(...point);
    if (gesture.kind === "end") gesture.xy = xy;
    if (gesture.kind === "paint") this.stroke(gesture, xy);
    if (gesture.kind === "obstacle") {
      const [dx, dy] = [point[0] - gesture.from[0], gesture.from[1] - point[1]];
      const far = Math.hypot(dx, dy);
      const speed = far < 6 ? 0 : Math.min(1, far / FULL) * page.scene.fastest;
      gesture.velocity = far ? [(dx / far) * speed, (dy / far) * speed] : [0, 0];
    }
  }

  end() {
    const { gesture, page } = this;
    this.gesture = null;
    const { kind, end, xy, velocity, obstacle, blocked, cells } = gesture;
    if (kind === "end") page.wish({ op: "move", end, xy });
    if (kind === "obstacle") page.wish({ op: "drop", xy, velocity, radius: page.scene.radii[0] ?? page.scene.radius });
    if (kind === "remove") page.wish({ op: "remove", obstacle });
    if (kind === "paint" && cells.size) {
      page.wish({ op: "paint", blocked, cells: [...cells.values()] });
      page.pending = { lane: null, kind, blocked, cells }; // shown until the server answers
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

  // What the gesture under way will do, over the stage's picture.
  draw(stage, gesture) {
    if (!gesture) return;
    const c = stage.context;
    if (gesture.kind === "paint") {
      const { resolution, x, y } = this.page.scene.map;
      const size = resolution * stage.scale;
      c.fillStyle = gesture.blocked ? stage.colour.wall : stage.colour.floor;
      for (const [row, col] of gesture.cells.values()) {
        const [left, top] = stage.toScreen([x + col * resolution, y + (row + 1) * resolution]);
        c.fillRect(left, top, size + 0.5, size + 0.5);
      }
    }
    if (gesture.kind === "obstacle") {
      const radius = this.page.scene.radii[0] ?? this.page.scene.radius;
      stage.drawObstacle({ id: "", x: gesture.xy[0], y: gesture.xy[1], radius, sensed: true, focus: true });
      const speed = Math.hypot(...gesture.velocity);
      const [sx, sy] = stage.toScreen(gesture.xy);
      const far = (FULL * stage.unit) / this.page.scene.fastest;
      const [ex, ey] = [sx + gesture.velocity[0] * far, sy - gesture.velocity[1] * far];
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
}

export { Editor };
