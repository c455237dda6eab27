import { LAYERS, Stage, navigate } from "/canvas.js";
import { Editor } from "/edit.js";

const byId = (id) => document.getElementById(id);
const choices = JSON.parse(byId("choices").textContent);
const HORIZON = 3; // s that predictions are drawn for
const MOST = 4 * 2 ** 20; // bytes of files to open
const CALM = ["follow", "arrived"];
const ASIDE = ["avoid", "step-aside", "step-back"];

const page = {
  scene: null, lanes: [], tool: "hand", brush: 1, pending: null, playing: false, speed: 1,
  show: Object.fromEntries(LAYERS.map(({ key }) => [key, true])),
  wish, redraw, obstacleAt,
};
const editor = new Editor(page);
const make = (tag, text, properties = {}) => Object.assign(document.createElement(tag), { textContent: text, ...properties });
const fixed = (value, digits, unit) => (value == null || !Number.isFinite(value) ? "–" : `${value.toFixed(digits)} ${unit}`);

// ---- the connection ----
const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`, ["antway", choices.token]);
socket.addEventListener("message", (event) => {
  const message = JSON.parse(event.data);
  if (message.kind === "frame") return takeFrame(message);
  busy("");
  if (message.kind === "scene") takeScene(message);
  if (message.kind === "file") download(message);
  if (message.kind === "refused") refuse(message);
});
socket.addEventListener("close", () => {
  page.playing = false;
  document.body.dataset.lost = "true";
  notice("The connection to antway is gone. Start `antway serve` again and reload this page.");
});

function wish(message) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function busy(text) {
  byId("busy").textContent = text;
}

function notice(text) {
  byId("notice").hidden = !text;
  byId("notice").firstElementChild.textContent = text;
}

let setting = null; // the parameter last sent
function refuse({ text }) {
  page.pending = null;
  if (setting) {
    setting.input.setAttribute("aria-invalid", "true");
    setting.wrong.textContent = text;
    if (!setting.input.offsetParent || setting.input.id === "seed") notice(text);
    setting = null;
  } else notice(text);
  redraw();
}

// ---- what comes from the server ----
const bits = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

// An image whose alpha is the amount, its first row the highest y.
function mask(rows, cols, amount) {
  const canvas = make("canvas", "", { width: cols, height: rows });
  const c = canvas.getContext("2d");
  const data = c.createImageData(cols, rows);
  for (let row = 0; row < rows; row++)
    for (let col = 0; col < cols; col++) data.data[((rows - 1 - row) * cols + col) * 4 + 3] = amount(row * cols + col);
  c.putImageData(data, 0, 0);
  return canvas;
}

function takeScene(scene) {
  const { map } = scene;
  for (const name of ["blocked", "unknown"]) {
    if (!map[name]) continue;
    const packed = bits(map[name]);
    map[name] = mask(map.rows, map.cols, (i) => ((packed[i >> 3] >> (i & 7)) & 1) * 255);
  }
  const sameMap = page.scene && ["rows", "cols", "resolution", "x", "y"].every((key) => page.scene.map[key] === map[key]);
  page.scene = scene;
  page.pending = null;
  notice("");
  document.documentElement.style.setProperty("--ratio", String(map.rows / map.cols));
  buildLanes(scene.policies);
  for (const lane of page.lanes) {
    lane.reset();
    if (sameMap && lane.stage.map) [lane.stage.map] = [map], lane.stage.tints.clear();
    else lane.stage.setMap(map);
  }
  if (sameMap) align(page.lanes[0].stage);
  const known = choices.scenes.includes(scene.name);
  byId("scene").replaceChildren(...choices.scenes.map((name) => make("option", name, { value: name })));
  if (!known) byId("scene").prepend(make("option", scene.name, { value: "", disabled: true }));
  byId("scene").value = known ? scene.name : "";
  document.title = `${scene.name} – antway`;
  byId("undo").disabled = !scene.undo;
  byId("redo").disabled = !scene.redo;
  byId("compare").setAttribute("aria-pressed", String(scene.policies.length > 1));
  setting = null;
  for (const { field, input, wrong } of fields) {
    input.value = String(scene.parameters[field]);
    input.removeAttribute("aria-invalid");
    wrong.textContent = "";
  }
  document.body.dataset.ready = "true";
  redraw();
}

function takeFrame(frame) {
  wish({ op: "seen" });
  page.playing = frame.playing;
  page.speed = frame.speed;
  frame.lanes.forEach((record, i) => page.lanes[i].take(record));
  byId("play").setAttribute("aria-label", frame.playing ? "Pause" : "Play");
  byId("play").classList.toggle("playing", frame.playing);
  byId("speed").value = String(frame.speed);
  const over = page.lanes.every((lane) => lane.now.outcome);
  byId("play").disabled = byId("step").disabled = over;
  byId("cards").setAttribute("aria-live", frame.playing ? "off" : "polite");
  byId("time").textContent = fixed(Math.max(...page.lanes.map((lane) => lane.now.t)), 1, "s");
  redraw();
}

function download({ name, type, text, base64 }) {
  const blob = new Blob([base64 === undefined ? text : bits(base64)], { type });
  save(blob, name);
}

function save(blob, name) {
  const link = make("a", "", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

// ---- one policy's half of the page ----
class Lane {
  constructor(index) {
    this.index = index;
    this.figure = byId("lane-template").content.firstElementChild.cloneNode(true);
    this.card = byId("card-template").content.firstElementChild.cloneNode(true);
    byId("lanes").append(this.figure);
    byId("cards").append(this.card);
    this.select = this.figure.querySelector("select");
    this.select.replaceChildren(...choices.policies.map((name) => make("option", name, { value: name })));
    this.select.addEventListener("change", () => askPolicies(page.lanes.map((lane) => lane.select.value)));
    this.stage = new Stage(this.figure.querySelector("canvas"));
    this.stage.unit = window.devicePixelRatio || 1;
    editor.listen(this);
    navigate(this.stage, () => (align(this.stage), redraw()));
    this.observer = new ResizeObserver(redraw);
    this.observer.observe(this.stage.canvas);
    this.reset();
  }

  remove() {
    this.observer.disconnect();
    this.figure.remove();
    this.card.remove();
  }

  reset() {
    [this.now, this.before, this.arrived] = [null, null, 0];
    [this.trail, this.ms, this.driven, this.decision, this.heat] = [[], [], [0], null, null];
  }

  take(record) {
    this.before = this.now;
    this.now = record;
    this.arrived = performance.now();
    this.trail.length = Math.min(this.trail.length, record.from);
    for (const point of record.trail) {
      const last = this.trail.at(-1);
      this.driven[this.trail.length] = last ? this.driven[this.trail.length - 1] + Math.hypot(point[0] - last[0], point[1] - last[1]) : 0;
      this.trail.push(point);
    }
    this.ms.length = Math.min(this.ms.length, Math.max(0, record.from - 1)); // a cycle leads to each row but the first
    this.ms.push(...record.ms);
    if ("decision" in record) {
      this.decision = record.decision;
      this.heat = null;
      const heat = record.decision?.pheromone;
      if (heat) {
        const shades = bits(heat.shades);
        this.heat = { ...heat, mask: mask(heat.rows, heat.cols, (i) => Math.round((215 * ((shades[i >> 1] >> (4 * (i & 1))) & 15)) / 15)) };
      }
    }
    this.describe();
  }

  // The moment that the stage draws: between the last two frames, so that motion is smooth at any rate of frames.
  moment(time) {
    const { now, before, decision } = this;
    const { scene } = page;
    const span = before && page.playing && !now.outcome ? now.t - before.t : 0;
    const share = span > 0 ? Math.min(1, (((time - this.arrived) / 1000) * page.speed) / span) : 1;
    const mix = (a, b) => (share < 1 ? a + (b - a) * share : b);
    const [x, y] = [0, 1].map((k) => mix(before?.robot[k], now.robot[k]));
    const obstacles = now.obstacles.map(([ox, oy, vx, vy, sensed], id) => ({
      id, vx, vy, radius: scene.radii[id], sensed: Boolean(sensed), focus: decision?.obstacle === id,
      x: mix(before?.obstacles[id]?.[0], ox), y: mix(before?.obstacles[id]?.[1], oy),
    }));
    const gesture = editor.gesture?.kind === "end" ? editor.gesture : null;
    const ends = { start: scene.start, goal: scene.goal, ...(gesture && { [gesture.end]: gesture.xy }) };
    const trail = share < 1 ? [...this.trail.slice(0, -1), [x, y]] : this.trail;
    return {
      ...ends, obstacles, trail, horizon: HORIZON, tolerance: scene.tolerance, global: scene.shortest, planned: decision?.path,
      target: decision?.target, pheromone: this.heat, moving: share < 1,
      robot: { x, y, heading: now.robot[2], radius: scene.radius, range: scene.range ?? Infinity },
    };
  }

  draw(time) {
    this.stage.resize();
    if (!this.now) return false;
    const moment = this.moment(time);
    this.shown = moment.obstacles;
    this.stage.draw(moment, page.show);
    editor.draw(this.stage, page.pending ?? (editor.gesture?.kind === "paint" || editor.gesture?.lane === this ? editor.gesture : null));
    return moment.moving;
  }

  describe() {
    const { now, decision, card, figure } = this;
    const outcome = figure.querySelector(".outcome");
    outcome.hidden = !now.outcome;
    outcome.textContent = (now.outcome ?? "").replaceAll("-", " ");
    outcome.title = now.ending;
    outcome.dataset.good = String(now.outcome === "reached");
    const driven = this.driven[this.trail.length - 1] ?? 0;
    figure.querySelector(".numbers").textContent =
      `${fixed(now.t, 1, "s")} · ${fixed(driven, 1, "m driven")} · ${fixed(now.speed, 2, "m/s")} · least clearance ${fixed(now.clearance, 2, "m")}`;
    this.stage.canvas.setAttribute("aria-label", `Map with the robot steered by ${this.select.value}; the panel says in words what it does.`);
    card.querySelector("h2").textContent = page.lanes.length > 1 ? `Decision of ${this.select.value}` : "Decision";
    const action = card.querySelector(".action");
    action.textContent = now.outcome ? now.outcome.replaceAll("-", " ") : (decision?.action.replaceAll("-", " ") ?? "ready");
    action.dataset.kind = !decision || CALM.includes(decision.action) ? "calm" : ASIDE.includes(decision.action) ? "planned" : "alert";
    card.querySelector(".reason").textContent = now.outcome ? now.ending : (decision?.reason ?? "Press play, or take one step.");
    const facts = [];
    if (decision?.obstacle != null) facts.push([`Obstacle ${decision.obstacle}`, decision.encounter.replaceAll("-", " ")]);
    if (decision?.closest[0] != null) facts.push(["Closest approach", `${fixed(decision.closest[1], 2, "m")} in ${fixed(decision.closest[0], 1, "s")}`]);
    if (decision?.guard) facts.push(["Guard", decision.guard.replaceAll("-", " ")]);
    if (decision?.gap != null) facts.push(["Certified gap", fixed(100 * decision.gap, 2, "%")]);
    for (const [name, cost] of decision?.alternatives ?? []) facts.push([name, cost == null ? "not possible" : fixed(cost, 2, "s")]);
    card.querySelector(".facts").replaceChildren(...facts.flatMap(([name, value]) => [make("dt", name), make("dd", value)]));
    this.spark();
  }

  // The policy's time for each of the last cycles.
  spark() {
    const canvas = this.card.querySelector(".spark");
    const last = this.ms.slice(-120);
    const top = Math.max(...last, 1e-9);
    [canvas.width, canvas.height] = [240, 56];
    const c = canvas.getContext("2d");
    c.fillStyle = this.stage.colour.robot;
    last.forEach((ms, i) => c.fillRect(i * 2, 56 - Math.max(2, (54 * ms) / top), 1.6, 56));
    this.card.querySelector(".cycle span").textContent = last.length ? `${fixed(last.at(-1), 2, "ms")} a cycle, worst ${fixed(top, 1, "ms")}` : "";
  }
}

function buildLanes(policies) {
  while (page.lanes.length > policies.length) page.lanes.pop().remove();
  while (page.lanes.length < policies.length) page.lanes.push(new Lane(page.lanes.length));
  policies.forEach((name, i) => (page.lanes[i].select.value = name));
}

// Show the same part of the map on every stage.
function align(from) {
  for (const { stage } of page.lanes) if (stage !== from) [stage.zoom, stage.centre] = [from.zoom, [...from.centre]];
}

function obstacleAt(lane, [x, y], reach) {
  const distance = ({ x: ox, y: oy, radius }) => Math.hypot(ox - x, oy - y) - radius;
  const near = (lane.shown ?? []).filter((o) => distance(o) <= reach).sort((a, b) => distance(a) - distance(b));
  return near.length ? near[0].id : -1;
}

let queued = false;
function redraw() {
  if (queued) return;
  queued = true;
  requestAnimationFrame((time) => {
    queued = false;
    const moving = page.lanes.map((lane) => lane.draw(time));
    if (moving.includes(true)) redraw();
  });
}

// ---- controls ----
const fields = [];

function askPolicies(names) {
  busy("preparing …");
  wish({ op: "policies", names });
}

function setTool(tool) {
  page.tool = tool;
  document.querySelector("main").dataset.tool = tool;
  for (const button of document.querySelectorAll("[data-tool]:not(main)")) button.setAttribute("aria-pressed", String(button.dataset.tool === tool));
  const brushing = tool === "wall" || tool === "erase";
  byId("brush").disabled = !brushing;
  byId("brush-label").classList.toggle("on", brushing);
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  byId("theme").setAttribute("aria-pressed", String(theme === "dark"));
  for (const { stage } of page.lanes) stage.refresh();
  redraw();
}

function toggle(key) {
  page.show[key] = !page.show[key];
  byId(`layer-${key}`).checked = page.show[key];
  redraw();
}

async function openFiles(list) {
  const files = [...list];
  if (!files.length) return;
  if (files.reduce((sum, file) => sum + file.size, 0) > MOST) return notice("These files are too large: at most 4 MiB together.");
  const read = (file) => new Promise((resolve, reject) => {
    const reader = new FileReader();
    reader.onload = () => resolve({ name: file.name, data: reader.result.slice(reader.result.indexOf(",") + 1) });
    reader.onerror = () => reject(reader.error);
    reader.readAsDataURL(file);
  });
  try {
    busy("opening …");
    wish({ op: "open", files: await Promise.all(files.map(read)) });
  } catch (error) {
    busy("");
    notice(`The file cannot be read: ${error.message}`);
  }
}

function picture() {
  const canvases = page.lanes.map((lane) => lane.stage.canvas);
  const whole = make("canvas", "", { width: canvases.reduce((sum, c) => sum + c.width, 0), height: canvases[0].height });
  const c = whole.getContext("2d");
  c.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--page");
  c.fillRect(0, 0, whole.width, whole.height);
  canvases.reduce((left, canvas) => (c.drawImage(canvas, left, 0), left + canvas.width), 0);
  whole.toBlob((blob) => save(blob, `antway-${page.scene.name.replace(/[^\w-]+/g, "-")}.png`));
}

function faster(by) {
  const at = choices.speeds.indexOf(page.speed) + by;
  if (choices.speeds[at] !== undefined) wish({ op: "speed", speed: choices.speeds[at] });
}

function field(parameter, input, wrong) {
  const entry = { field: parameter.field, input, wrong };
  fields.push(entry);
  input.addEventListener("change", () => {
    const value = input.value.trim() === "" ? NaN : Number(input.value);
    setting = entry;
    wish({ op: "set", field: parameter.field, value: Number.isFinite(value) ? value : input.value });
  });
}

function build() {
  byId("speed").replaceChildren(...choices.speeds.map((speed) => make("option", `${speed}×`, { value: String(speed) })));
  byId("layers").replaceChildren(...LAYERS.map(({ key, label, swatch }, i) => {
    const row = make("label", "");
    const box = make("input", "", { type: "checkbox", id: `layer-${key}`, checked: true, title: `Key ${i + 1}` });
    box.addEventListener("change", () => ((page.show[key] = box.checked), redraw()));
    row.append(box, make("span", "", { className: `swatch ${swatch} of-${key}` }), make("span", label));
    return row;
  }));
  for (const parameter of choices.parameters) {
    const { field: name, label, unit, low, high, meaning } = parameter;
    if (name === "seed") {
      field(parameter, byId("seed"), make("span", ""));
      byId("seed").title = meaning;
    }
    const row = make("label", "");
    const input = make("input", "", { inputMode: "decimal", id: `parameter-${name}` });
    const wrong = make("span", "", { className: "wrong", id: `wrong-${name}` });
    wrong.setAttribute("role", "alert");
    input.setAttribute("aria-describedby", wrong.id);
    row.append(make("span", unit ? `${label}, ${unit}` : label), input, wrong, make("small", `${meaning} ${low} to ${high}${unit && ` ${unit}`}.`));
    byId("parameters").append(row);
    field(parameter, input, wrong);
  }
}

function listen() {
  const on = (id, kind, action) => byId(id).addEventListener(kind, action);
  const play = () => byId("play").disabled || wish({ op: "play", on: !page.playing });
  const actions = {
    play, step: () => wish({ op: "step" }), reset: () => wish({ op: "reset" }), undo: () => wish({ op: "undo" }), redo: () => wish({ op: "redo" }),
    open: () => byId("files").click(), fit: () => { for (const { stage } of page.lanes) stage.fit(); redraw(); },
    theme: () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
    compare: () => askPolicies(page.lanes.length > 1 ? [page.lanes[0].select.value] : [page.lanes[0].select.value, page.lanes[0].select.value === "paper" ? "antway" : "paper"]),
    "save-png": picture,
  };
  for (const what of ["scenario", "trace", "replay"]) actions[`save-${what}`] = () => (busy("writing …"), wish({ op: "export", what }));
  for (const [id, action] of Object.entries(actions)) on(id, "click", action);
  const menu = document.querySelector(".menu");
  menu.addEventListener("click", (event) => event.target.tagName === "BUTTON" && (menu.open = false));
  document.addEventListener("pointerdown", (event) => menu.contains(event.target) || (menu.open = false));
  on("scene", "change", (event) => (busy("opening …"), wish({ op: "scene", name: event.target.value })));
  on("speed", "change", (event) => wish({ op: "speed", speed: Number(event.target.value) }));
  on("brush", "change", (event) => (page.brush = Number(event.target.value)));
  on("files", "change", (event) => (openFiles(event.target.files), (event.target.value = "")));
  on("parameters", "submit", (event) => event.preventDefault());
  byId("notice").lastElementChild.addEventListener("click", () => notice(""));
  for (const button of document.querySelectorAll(".palette [data-tool]")) button.addEventListener("click", () => setTool(button.dataset.tool));
  const main = document.querySelector("main");
  main.addEventListener("dragover", (event) => (event.preventDefault(), main.classList.add("over")));
  main.addEventListener("dragleave", () => main.classList.remove("over"));
  main.addEventListener("drop", (event) => {
    event.preventDefault();
    main.classList.remove("over");
    openFiles(event.dataTransfer.files);
  });
  document.addEventListener("keydown", (event) => {
    if (event.altKey || ["SELECT"].includes(event.target.tagName) || (event.target.tagName === "INPUT" && event.target.type !== "checkbox")) return;
    const key = event.key.toLowerCase();
    if (event.ctrlKey || event.metaKey) {
      if (key === "z") event.preventDefault(), wish({ op: event.shiftKey ? "redo" : "undo" });
      return;
    }
    const onButton = ["BUTTON", "INPUT", "SUMMARY"].includes(event.target.tagName);
    const tools = { v: "hand", w: "wall", e: "erase", o: "obstacle" };
    const keys = {
      " ": onButton ? null : actions.play, arrowright: () => byId("step").disabled || actions.step(), r: actions.reset, "+": () => faster(1), "-": () => faster(-1),
      f: actions.fit, t: actions.theme, c: actions.compare, escape: () => ((menu.open = false), editor.drop(), notice("")),
    };
    const layer = LAYERS[Number(key) - 1];
    const action = keys[key] ?? (tools[key] ? () => setTool(tools[key]) : layer ? () => toggle(layer.key) : null);
    if (!action) return;
    event.preventDefault();
    action();
  });
}

build();
listen();
setTool("hand");
setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
