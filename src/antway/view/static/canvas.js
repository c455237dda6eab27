// Draws a map and one moment of an episode on a canvas; keeps nothing but the view (pan and zoom), the map and the colours.
// Distances are in metres, y points up, or down on a map that is drawn so (top_first). A moment is a plain object, all of it optional but the robot:
//   robot {x, y, heading, radius, range, occlusion}, start [x, y], goal [x, y], tolerance, trail, global [[x, y], ...],
//   stops [{at, number, done, late}], planned [[x, y], ...], target [x, y], obstacles [{id, x, y, vx, vy, radius, sensed, focus}], and what layers.js draws:
//   tubes, trails, pheromone, field {mask, row, col, height, width}, braking. A mask is an image whose alpha is the amount; its
//   first row is the highest y.
import { make, pointOn } from "./common.js";
import { HORIZON, drawAmounts, drawBraking, drawSight, drawTrails, drawTubes } from "./layers.js";

// `live`: known while the episode runs but not kept in its trace. `off`: not shown at first.
const LAYERS = [
  { key: "global", label: "Shortest path", swatch: "dash" },
  { key: "trail", label: "Path driven", swatch: "line" },
  { key: "planned", label: "Planned path", swatch: "line" },
  { key: "target", label: "Local target", swatch: "diamond" },
  { key: "prediction", label: `Predicted, next ${HORIZON} s`, swatch: "area" },
  { key: "range", label: "Sensed range", swatch: "dot" },
  { key: "pheromone", label: "Pheromone by cell", swatch: "area" },
  { key: "trails", label: "Ants' trails", swatch: "line", live: true },
  { key: "braking", label: "Guard's braking area", swatch: "dash", live: true },
  { key: "field", label: "Distance to the goal", swatch: "area", live: true, off: true },
];

class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.map = null;
    this.zoom = 1;
    this.centre = [0, 0];
    this.tints = new Map();
    this.refresh();
  }

  // Read the colours from the page's custom properties, after a change of theme.
  refresh() {
    const css = getComputedStyle(document.documentElement);
    const names = ["floor", "wall", "unknown", "rule", "ink", "robot", "moving", "planned", "prediction", "pheromone", "goal", "trails",
      "braking", "field"];
    this.colour = Object.fromEntries(names.map((name) => [name, css.getPropertyValue(`--${name}`).trim()]));
    this.colour.number = css.getPropertyValue("--on-moving").trim();
    this.tints.clear();
  }

  // map {rows, cols, resolution, x, y, top_first, blocked, unknown}: masks, the outer corner of cell (0, 0), and whether row 0 is on top.
  setMap(map) {
    this.change(map);
    this.fit();
  }

  // Whether a point in metres is on the map and not in a wall.
  isFree([px, py]) {
    const { rows, cols, resolution, x, y } = this.map;
    const [row, col] = [Math.floor((py - y) / resolution), Math.floor((px - x) / resolution)];
    return row >= 0 && col >= 0 && row < rows && col < cols && !this.solid[row * cols + col];
  }

  // Show another map of the same size and place.
  change(map) {
    this.map = map;
    this.tints.clear();
    const masks = [map.blocked, map.unknown].filter(Boolean).map((mask) => alphas(mask, map.rows, map.cols));
    this.solid = new Uint8Array(map.rows * map.cols);
    for (let row = 0; row < map.rows; row++)
      for (let col = 0; col < map.cols; col++)
        for (const alpha of masks) if (alpha[((map.rows - 1 - row) * map.cols + col) * 4 + 3]) this.solid[row * map.cols + col] = 1;
  }

  fit() {
    const { rows, cols, resolution, x, y } = this.map;
    this.zoom = 1;
    this.centre = [x + (cols * resolution) / 2, y + (rows * resolution) / 2];
  }

  // Match the canvas's pixels to its size on the screen.
  resize() {
    const ratio = window.devicePixelRatio || 1;
    const { width, height } = this.canvas.getBoundingClientRect();
    const [w, h] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
    if (this.canvas.width !== w || this.canvas.height !== h) [this.canvas.width, this.canvas.height] = [w, h];
  }

  // Pixels of the canvas for a metre.
  get scale() {
    const { rows, cols, resolution } = this.map;
    const margin = 0.96;
    return this.zoom * margin * Math.min(this.canvas.width / (cols * resolution), this.canvas.height / (rows * resolution));
  }

  // 1 where y points up on the screen, -1 where it points down.
  get up() {
    return this.map.top_first ? -1 : 1;
  }

  toScreen([x, y]) {
    const s = this.scale;
    return [this.canvas.width / 2 + (x - this.centre[0]) * s, this.canvas.height / 2 - this.up * (y - this.centre[1]) * s];
  }

  // Metres of a point given in pixels of the page relative to the canvas.
  toWorld(left, top) {
    const ratio = this.canvas.width / this.canvas.getBoundingClientRect().width;
    const s = this.scale;
    return [
      this.centre[0] + (left * ratio - this.canvas.width / 2) / s,
      this.centre[1] - (this.up * (top * ratio - this.canvas.height / 2)) / s,
    ];
  }

  // Left, top, width and height in pixels of a rectangle of cells.
  boxOf(row, col, height, width) {
    const { resolution, x, y } = this.map;
    const [left, top] = this.toScreen([x + col * resolution, y + (this.up > 0 ? row + height : row) * resolution]);
    return [left, top, width * resolution * this.scale, height * resolution * this.scale];
  }

  // Draw a mask, whose first row is the highest y, over a rectangle of pixels; one that shows several cells has the most of them.
  drawMask(mask, colour, [left, top, width, height]) {
    const c = this.context;
    const [cols, rows] = sizeOf(mask);
    const block = Math.max(1, Math.ceil(cols / width - 1e-6), Math.ceil(rows / height - 1e-6));
    const tint = this.tinted(mask, colour, block);
    c.save();
    c.imageSmoothingEnabled = false;
    c.translate(left, this.up > 0 ? top : top + height);
    c.scale(1, this.up);
    c.beginPath();
    c.rect(0, 0, width, height);
    c.clip(); // the last blocks may be larger than what is left of the map
    c.drawImage(tint, 0, 0, (width * tint.width * block) / cols, (height * tint.height * block) / rows);
    c.restore();
  }

  // Zoom by a factor about a point of the page, which stays where it is.
  zoomAt(factor, left, top) {
    const before = this.toWorld(left, top);
    this.zoom = Math.min(40, Math.max(1, this.zoom * factor));
    const after = this.toWorld(left, top);
    this.panBy(before[0] - after[0], before[1] - after[1]);
  }

  // Move the view by metres, keeping its centre on the map.
  panBy(dx, dy) {
    if (this.zoom === 1) return this.fit();
    const { rows, cols, resolution, x, y } = this.map;
    this.centre[0] = Math.min(x + cols * resolution, Math.max(x, this.centre[0] + dx));
    this.centre[1] = Math.min(y + rows * resolution, Math.max(y, this.centre[1] + dy));
  }

  draw(moment, show) {
    const c = this.context;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.unit = window.devicePixelRatio || 1;
    this.drawMap();
    const obstacles = moment.obstacles ?? [];
    if (show.field && moment.field) drawAmounts(this, moment.field, this.colour.field, false);
    if (show.pheromone && moment.pheromone) drawAmounts(this, moment.pheromone, this.colour.pheromone, true);
    if (show.prediction && moment.tubes) drawTubes(this, moment.tubes);
    if (show.range && Number.isFinite(moment.robot.range)) drawSight(this, moment.robot);
    if (show.trails && moment.trails) drawTrails(this, moment.trails);
    if (show.global) this.line(moment.global, this.colour.ink, 1.6, [7, 5]);
    if (show.braking && moment.braking) drawBraking(this, moment.robot, moment.braking, obstacles);
    if (show.planned) this.line(moment.planned, this.colour.planned, 2.6, [], true);
    if (show.trail) this.line(moment.trail, this.colour.robot, 3, [], true);
    if (show.target && moment.target) this.diamond(moment.target);
    if (moment.goal) this.drawEnds(moment);
    for (const stop of moment.stops ?? []) this.drawStop(stop);
    for (const obstacle of obstacles) this.drawObstacle(obstacle);
    this.drawRobot(moment.robot);
  }

  drawMap() {
    const { rows, cols, resolution, blocked, unknown } = this.map;
    const c = this.context;
    const box = this.boxOf(0, 0, rows, cols);
    const [left, top, width, height] = box;
    c.fillStyle = this.colour.floor;
    c.fillRect(left, top, width, height);
    if (unknown) this.drawMask(unknown, this.colour.unknown, box);
    this.drawMask(blocked, this.colour.wall, box);
    const cell = resolution * this.scale;
    if (cell > 9 * this.unit && Math.max(rows, cols) <= 200) {
      c.beginPath();
      for (let k = 1; k < cols; k++) c.moveTo(left + k * cell, top), c.lineTo(left + k * cell, top + height);
      for (let k = 1; k < rows; k++) c.moveTo(left, top + k * cell), c.lineTo(left + width, top + k * cell);
      this.stroke(this.colour.rule, 0.6);
    }
    c.strokeStyle = this.colour.wall;
    c.lineWidth = 1.5 * this.unit;
    c.strokeRect(left, top, width, height);
  }

  drawObstacle({ id, x, y, radius, sensed, focus }) {
    const c = this.context;
    const [sx, sy] = this.toScreen([x, y]);
    const r = Math.max(radius * this.scale, 3 * this.unit);
    this.disc([sx, sy], r, sensed ? this.colour.moving : this.colour.floor, this.colour.moving, sensed ? 1 : 2);
    if (focus) {
      c.beginPath();
      c.arc(sx, sy, r + 4 * this.unit, 0, 2 * Math.PI);
      this.stroke(this.colour.moving, 2);
    }
    if (r > 7 * this.unit) {
      c.fillStyle = sensed ? this.colour.number : this.colour.moving;
      c.font = `600 ${Math.min(r, 13 * this.unit)}px system-ui, sans-serif`;
      c.textAlign = "center";
      c.textBaseline = "middle";
      c.fillText(String(id), sx, sy);
    }
  }

  drawRobot({ x, y, heading, radius }) {
    const c = this.context;
    const [sx, sy] = this.toScreen([x, y]);
    const r = Math.max(radius * this.scale, 4 * this.unit);
    this.disc([sx, sy], r, this.colour.robot, this.colour.floor, 1.5);
    c.beginPath();
    c.moveTo(sx, sy);
    c.lineTo(sx + r * Math.cos(heading), sy - this.up * r * Math.sin(heading));
    this.stroke("#ffffff", 2);
  }

  drawEnds({ start, goal, tolerance }) {
    const c = this.context;
    if (start) this.disc(this.toScreen(start), 5 * this.unit, this.colour.floor, this.colour.ink, 2);
    const [sx, sy] = this.toScreen(goal);
    const r = Math.max((tolerance ?? 0) * this.scale, 9 * this.unit);
    c.beginPath();
    for (let k = 0; k < 10; k++) {
      const a = (k * Math.PI) / 5 - Math.PI / 2;
      const tip = k % 2 ? r * 0.42 : r;
      c.lineTo(sx + tip * Math.cos(a), sy + tip * Math.sin(a));
    }
    c.closePath();
    c.fillStyle = this.colour.goal;
    c.fill();
    this.stroke(this.colour.ink, 1.2);
  }

  // A place to visit and its number: filled until it is done, red where it came too late.
  drawStop({ at, number, done, late }) {
    const c = this.context;
    const [sx, sy] = this.toScreen(at);
    const colour = late ? this.colour.moving : this.colour.robot;
    const [inside, outside] = done ? [this.colour.floor, colour] : [colour, this.colour.floor];
    this.disc([sx, sy], 9 * this.unit, inside, outside, 1.5);
    c.fillStyle = outside;
    c.font = `600 ${10 * this.unit}px system-ui, sans-serif`;
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.fillText(String(number), sx, sy);
  }

  // A disc of radius r around a point, both in pixels of the canvas.
  disc([x, y], r, fill, edge, width) {
    this.context.beginPath();
    this.context.arc(x, y, r, 0, 2 * Math.PI);
    this.context.fillStyle = fill;
    this.context.fill();
    this.stroke(edge, width);
  }

  diamond(point) {
    const c = this.context;
    const [sx, sy] = this.toScreen(point);
    const r = 7 * this.unit;
    c.beginPath();
    for (const [dx, dy] of [[0, -r], [r, 0], [0, r], [-r, 0]]) c.lineTo(sx + dx, sy + dy);
    c.closePath();
    c.fillStyle = this.colour.planned;
    c.fill();
    this.stroke(this.colour.floor, 1.5);
  }

  line(points, colour, width, dash = [], cased = false) {
    if (!points || points.length < 2) return;
    const c = this.context;
    c.lineJoin = "round";
    c.beginPath();
    for (const point of points) c.lineTo(...this.toScreen(point));
    if (cased) this.stroke(this.colour.floor, width + 2.4);
    this.stroke(colour, width, dash);
  }

  stroke(colour, width, dash = []) {
    const c = this.context;
    c.setLineDash(dash.map((d) => d * this.unit));
    c.strokeStyle = colour;
    c.lineWidth = width * this.unit;
    c.stroke();
    c.setLineDash([]);
  }

  // The mask in one colour, a pixel for `block` x `block` cells, kept until that, the colours or the map change.
  tinted(mask, colour, block) {
    let kept = this.tints.get(mask);
    if (kept?.block !== block) {
      if (this.tints.size > 64) this.tints.clear();
      const tint = coarse(mask, block);
      const c = tint.getContext("2d");
      c.globalCompositeOperation = "source-in";
      c.fillStyle = colour;
      c.fillRect(0, 0, tint.width, tint.height);
      this.tints.set(mask, (kept = { block, tint }));
    }
    return kept.tint;
  }
}

const sizeOf = (mask) => [mask.naturalWidth || mask.width, mask.naturalHeight || mask.height];

// A canvas with the largest alpha of each `block` x `block` cells of a mask.
function coarse(mask, block) {
  const [cols, rows] = sizeOf(mask);
  const [width, height] = [Math.ceil(cols / block), Math.ceil(rows / block)];
  const canvas = make("canvas", "", { width, height });
  const c = canvas.getContext("2d");
  if (block === 1) return c.drawImage(mask, 0, 0), canvas;
  const [fine, data] = [alphas(mask, rows, cols), c.createImageData(width, height)];
  for (let row = 0; row < rows; row++)
    for (let col = 0; col < cols; col++) {
      const at = (Math.floor(row / block) * width + Math.floor(col / block)) * 4 + 3;
      data.data[at] = Math.max(data.data[at], fine[(row * cols + col) * 4 + 3]);
    }
  c.putImageData(data, 0, 0);
  return canvas;
}

// The red, green, blue and alpha of a mask of rows x cols.
function alphas(mask, rows, cols) {
  const c = make("canvas", "", { width: cols, height: rows }).getContext("2d", { willReadFrequently: true });
  c.drawImage(mask, 0, 0);
  return c.getImageData(0, 0, cols, rows).data;
}

// Drag to pan when zoomed in, wheel or two fingers to zoom, double click to see all; `changed` is called after each.
function navigate(stage, changed) {
  const canvas = stage.canvas;
  const held = new Map();
  const at = (event) => pointOn(canvas, event);
  const done = () => {
    canvas.style.touchAction = stage.zoom > 1 ? "none" : "pan-y";
    changed();
  };
  canvas.style.touchAction = "pan-y";
  canvas.addEventListener("pointerdown", (event) => {
    held.set(event.pointerId, at(event));
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const now = at(event);
    held.set(event.pointerId, now);
    if (held.size === 2) {
      const other = [...held].find(([id]) => id !== event.pointerId)[1];
      const spread = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      stage.zoomAt(spread(now) / Math.max(1, spread(before)), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    } else {
      const [a, b] = [stage.toWorld(...before), stage.toWorld(...now)];
      stage.panBy(a[0] - b[0], a[1] - b[1]);
    }
    done();
  });
  for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => held.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    stage.zoomAt(Math.exp(-event.deltaY / 400), ...at(event));
    done();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => (stage.fit(), done()));
}

export { HORIZON, LAYERS, Stage, navigate };
