// The layers of a moment that are more than a line: each draws itself on a Stage.

const HORIZON = 3; // s that predictions are drawn for
const RAYS = 720; // of the outline of what is sensed

// An image of amounts, {mask, row, col, height, width} in cells, in one colour.
function drawAmounts(stage, { mask, row, col, height, width }, colour, framed) {
  const c = stage.context;
  const box = stage.boxOf(row, col, height, width);
  stage.drawMask(mask, colour, box);
  if (!framed) return;
  c.strokeStyle = colour;
  c.lineWidth = stage.unit;
  c.strokeRect(...box);
}

// What each sensed obstacle sweeps in the next seconds as predicted, {radius, growth, path [[s, x, y], ...]}, paler with time.
function drawTubes(stage, tubes) {
  const c = stage.context;
  c.save();
  c.globalAlpha = 0.24;
  c.fillStyle = stage.colour.prediction;
  for (const fraction of [1, 2 / 3, 1 / 3]) {
    const path = new Path2D(); // one path, all of it clockwise: what overlaps is filled once
    for (const tube of tubes) sweep(stage, path, tube, HORIZON * fraction);
    c.fill(path);
  }
  c.restore();
}

function sweep(stage, path, { radius, growth, path: knots }, until) {
  if (knots[0][0] > until) return;
  let before = null;
  for (let i = 0; i < knots.length && (i === 0 || knots[i - 1][0] < until); i++) {
    let [t, x, y] = knots[i];
    if (t > until) {
      const [s, a, b] = knots[i - 1];
      const part = (until - s) / (t - s);
      [t, x, y] = [until, a + (x - a) * part, b + (y - b) * part];
    }
    const [sx, sy] = stage.toScreen([x, y]);
    const r = (radius + growth * t) * stage.scale;
    path.moveTo(sx + r, sy);
    path.arc(sx, sy, r, 0, 2 * Math.PI);
    if (before) {
      const [px, py, p] = before;
      const far = Math.hypot(sx - px, sy - py);
      if (far > 1e-9) {
        const [nx, ny] = [(sy - py) / far, (px - sx) / far];
        path.moveTo(px + nx * p, py + ny * p);
        path.lineTo(sx + nx * r, sy + ny * r);
        path.lineTo(sx - nx * r, sy - ny * r);
        path.lineTo(px - nx * p, py - ny * p);
        path.closePath();
      }
    }
    before = [sx, sy, r];
  }
}

// The moves that ants laid pheromone on, [[x, y, x, y, fraction of the most], ...]: the more, the bolder.
function drawTrails(stage, trails) {
  const c = stage.context;
  c.save();
  c.lineCap = "round";
  for (let k = 1; k <= 4; k++) {
    c.beginPath();
    for (const [ax, ay, bx, by, fraction] of trails) {
      if (Math.min(4, Math.floor(fraction * 4) + 1) !== k) continue;
      c.moveTo(...stage.toScreen([ax, ay]));
      c.lineTo(...stage.toScreen([bx, by]));
    }
    c.globalAlpha = 0.25 + 0.18 * k;
    stage.stroke(stage.colour.trails, 1 + k);
  }
  c.restore();
}

// The outline of what the robot can sense: within its range, and not behind walls where they hide what moves.
function drawSight(stage, { x, y, range, occlusion }) {
  const c = stage.context;
  c.beginPath();
  if (occlusion) for (const point of outline(stage, x, y, range)) c.lineTo(...stage.toScreen(point));
  else c.arc(...stage.toScreen([x, y]), range * stage.scale, 0, 2 * Math.PI);
  c.closePath();
  c.save();
  c.globalAlpha = 0.06;
  c.fillStyle = stage.colour.ink;
  c.fill();
  c.restore();
  stage.stroke(stage.colour.ink, 1.1, [2, 4]);
}

// Points in metres where rays from (x, y) end: at the range, at the first solid cell, or off the map.
function outline(stage, x, y, range) {
  const { rows, cols, resolution, x: x0, y: y0 } = stage.map;
  const { solid } = stage;
  const [u, v] = [(x - x0) / resolution, (y - y0) / resolution];
  const most = Math.min(range / resolution, rows + cols);
  const points = [];
  for (let k = 0; k < RAYS; k++) {
    const [du, dv] = [Math.cos((2 * Math.PI * k) / RAYS), Math.sin((2 * Math.PI * k) / RAYS)];
    let [col, row, far] = [Math.floor(u), Math.floor(v), 0];
    const [toCol, toRow] = [Math.sign(du), Math.sign(dv)];
    let nextCol = du ? (col + (du > 0) - u) / du : Infinity;
    let nextRow = dv ? (row + (dv > 0) - v) / dv : Infinity;
    while (far < most && col >= 0 && row >= 0 && col < cols && row < rows && !solid[row * cols + col]) {
      if (nextCol < nextRow) [far, col, nextCol] = [nextCol, col + toCol, nextCol + 1 / Math.abs(du)];
      else [far, row, nextRow] = [nextRow, row + toRow, nextRow + 1 / Math.abs(dv)];
    }
    far = Math.min(far, most);
    points.push([x0 + (u + far * du) * resolution, y0 + (v + far * dv) * resolution]);
  }
  return points;
}

// What the guard compares: the area that the robot needs to stop, and how far each sensed obstacle can move until then.
function drawBraking(stage, robot, { distance, direction, stoppingTime, fastest, acceleration }, obstacles) {
  if (!stoppingTime) return;
  const c = stage.context;
  const end = [robot.x + distance * Math.cos(direction), robot.y + distance * Math.sin(direction)];
  c.save();
  c.lineCap = "round";
  c.globalAlpha = 0.35;
  c.beginPath();
  c.moveTo(...stage.toScreen([robot.x, robot.y]));
  c.lineTo(...stage.toScreen(end));
  c.strokeStyle = stage.colour.braking;
  c.lineWidth = 2 * robot.radius * stage.scale;
  c.stroke();
  c.restore();
  c.beginPath();
  const [ex, ey] = stage.toScreen(end);
  c.arc(ex, ey, robot.radius * stage.scale, 0, 2 * Math.PI);
  for (const { x, y, vx, vy, radius, sensed } of obstacles) {
    if (!sensed) continue;
    const farthest = radius + Math.min(fastest, Math.hypot(vx, vy) + acceleration * stoppingTime) * stoppingTime;
    const [sx, sy] = stage.toScreen([x, y]);
    c.moveTo(sx + farthest * stage.scale, sy);
    c.arc(sx, sy, farthest * stage.scale, 0, 2 * Math.PI);
  }
  stage.stroke(stage.colour.braking, 1.6, [6, 3]);
}

export { HORIZON, drawAmounts, drawBraking, drawSight, drawTrails, drawTubes };
