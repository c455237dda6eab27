// The page of tours: a colony at work on a travelling salesman problem.
import { bits, boxes, byId, fixed, inNextFrame, make, pointOn, save, showPlaying, themes } from "/common.js";
import { mark, tips } from "/terms.js";
import { busy, choices, choose, connect, listenToKeys, menus, notice, numberOf, refuse, setting, showSettings, stemOf, takeFiles, working } from "/parts.js";

const LAYERS = [
  { key: "trails", label: "Pheromone on edges", swatch: "line" },
  { key: "trail", label: "Best tour", swatch: "line" },
  { key: "cities", label: "Cities", swatch: "dot" },
];
const SETTINGS = [
  { field: "rule", label: "Rule", options: choices.rules, meaning: "Which ants deposit, and within which limits: Ant System, elitist, rank-based, MAX-MIN, Ant Colony System." },
  { field: "persistence", label: "Persistence", options: choices.persistences, meaning: "Share of the pheromone that remains after a cycle; adaptive: strong edges keep more." },
  { field: "search", label: "Local search", options: choices.searches, meaning: "What improves each tour before it deposits." },
  { field: "ants", label: "Ants", meaning: "In a cycle. 1 to 200; from 2,000 cities on with local search, 4 that change tours." },
  { field: "seed", label: "Seed", meaning: "Same seed, same run. 0 to 9007199254740991." },
];
const MARGIN = 20; // pixels of the page around the map
const NEAR = 10; // pixels of the page; a press this near to a city removes it
const state = {
  scene: null, frame: null, cities: [], curve: [], cursor: null, show: Object.fromEntries(LAYERS.map(({ key }) => [key, true])),
};

const request = connect("/tours", (message) => {
  if (message.kind === "frame") takeFrame(message);
  if (message.kind === "scene") takeScene(message);
  if (message.kind === "refused") refuse(message);
});

const pairs = (text) => {
  const flat = new Uint16Array(bits(text).buffer);
  return Array.from({ length: flat.length / 2 }, (_, i) => [flat[2 * i], flat[2 * i + 1]]);
};

function takeScene(scene) {
  Object.assign(state, { scene, frame: null, cities: pairs(scene.cities), curve: [] });
  choose("instance", choices.instances, scene.name);
  showSettings(scene.settings);
  byId("optimum-key").hidden = scene.optimum == null;
  byId("curve-title").textContent = scene.optimum == null ? "Length by cycle" : "Gap to the optimum by cycle";
  byId("map").setAttribute("aria-label", `${scene.size} cities, the pheromone on their edges, and the best tour. The arrow keys move a cursor, Enter adds or removes a city there.`);
  document.title = `${scene.name} – tours – antway`;
  redraw();
}

function takeFrame(frame) {
  request({ op: "seen" });
  busy("");
  state.frame = { ...frame, tour: frame.tour && new Uint16Array(bits(frame.tour).buffer), ends: pairs(frame.ends), amounts: bits(frame.amounts) };
  state.curve.push(...frame.curve);
  if (state.curve.length > 4000) state.curve = state.curve.filter((_, i) => i % 2 === 0 || i > 3000);
  showPlaying(frame.playing);
  byId("play").disabled = byId("step").disabled = frame.ended;
  byId("speed").value = String(frame.speed);
  const put = (id, text) => (byId(id).textContent = text);
  put("best", frame.best == null ? "–" : frame.best.toLocaleString("en", { maximumFractionDigits: 1 }));
  put("gap", state.scene.optimum == null ? "optimum not known" : frame.gap == null ? "–" : frame.ended ? "0 %, the shortest" : fixed(frame.gap, 2, "%"));
  put("cycle", frame.cycle.toLocaleString("en"));
  put("made", frame.tours.toLocaleString("en"));
  put("time", `cycle ${frame.cycle}`);
  redraw();
}

// ---- drawing ----
const colourOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function sized(id) {
  const canvas = byId(id);
  const unit = window.devicePixelRatio || 1;
  const { width, height } = canvas.getBoundingClientRect();
  [canvas.width, canvas.height] = [Math.max(1, Math.round(width * unit)), Math.max(1, Math.round(height * unit))];
  return { c: canvas.getContext("2d"), width: canvas.width, height: canvas.height, unit };
}

// Where the map lies on a canvas of this size: from places of the scene to the canvas and back.
function laid(width, height, margin) {
  const [wide, high] = state.scene.frame;
  const scale = Math.min((width - 2 * margin) / wide, (height - 2 * margin) / high);
  return {
    scale,
    to: ([x, y]) => [width / 2 + (x - wide / 2) * scale, height / 2 - (y - high / 2) * scale],
    from: ([left, top]) => [wide / 2 + (left - width / 2) / scale, high / 2 - (top - height / 2) / scale],
  };
}

function drawMap() {
  const { c, width, height, unit } = sized("map");
  c.fillStyle = colourOf("page");
  c.fillRect(0, 0, width, height);
  const { cities, frame, show } = state;
  const { to } = laid(width, height, MARGIN * unit);
  const places = cities.map(to);
  const [[left, bottom], [right, top]] = [to([0, 0]), to(state.scene.frame)];
  const rim = (MARGIN - 8) * unit;
  c.fillStyle = colourOf("floor");
  c.fillRect(left - rim, top - rim, right - left + 2 * rim, bottom - top + 2 * rim);
  c.lineCap = c.lineJoin = "round";
  if (show.trails && frame) {
    c.strokeStyle = colourOf("trails");
    for (let k = 0; k < 6; k++) {
      c.globalAlpha = 0.12 + 0.13 * k;
      c.lineWidth = (0.8 + 0.9 * k) * unit;
      c.beginPath();
      frame.ends.forEach(([a, b], i) => {
        if (Math.min(5, Math.floor((frame.amounts[i] / 256) * 6)) !== k) return;
        c.moveTo(...places[a]);
        c.lineTo(...places[b]);
      });
      c.stroke();
    }
    c.globalAlpha = 1;
  }
  if (show.trail && frame?.tour) {
    c.beginPath();
    for (const city of frame.tour) c.lineTo(...places[city]);
    c.closePath();
    c.strokeStyle = colourOf("robot");
    c.lineWidth = (cities.length > 1000 ? 1.1 : 2) * unit;
    c.stroke();
  }
  if (show.cities) {
    const r = Math.max(1, Math.min(4, 60 / Math.sqrt(cities.length))) * unit;
    c.fillStyle = colourOf("ink");
    c.beginPath();
    for (const [x, y] of places) c.moveTo(x + r, y), c.arc(x, y, r, 0, 2 * Math.PI);
    c.fill();
  }
  if (state.cursor) {
    c.beginPath();
    c.arc(...to(state.cursor), NEAR * unit, 0, 2 * Math.PI);
    c.strokeStyle = colourOf("ink");
    c.lineWidth = 2 * unit;
    c.stroke();
  }
}

// Add a city at this place of the scene, or remove the one that is there.
function press(place) {
  const [wide, high] = state.scene.frame;
  const most = Math.max(wide, high);
  const { clientWidth, clientHeight } = byId("map");
  const near = NEAR / laid(clientWidth, clientHeight, MARGIN).scale / most;
  const [x, y] = [Math.min(wide, Math.max(0, place[0])), Math.min(high, Math.max(0, place[1]))].map((v) => v / most);
  if (Math.hypot(x - place[0] / most, y - place[1] / most) <= near) request({ op: "city", xy: [x, y], near: Math.min(0.1, near) });
}

// The arrow keys move a cursor by a fiftieth of the map, Enter presses there.
function pressKey(event) {
  const step = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[event.key];
  if (event.ctrlKey || event.altKey || event.metaKey || !(step || (event.key === "Enter" && state.cursor))) return;
  event.preventDefault();
  event.stopPropagation();
  const { frame } = state.scene;
  const from = state.cursor ?? frame.map((side) => side / 2);
  if (step) state.cursor = from.map((v, k) => Math.min(frame[k], Math.max(0, v + (step[k] * Math.max(...frame)) / 50)));
  else press(state.cursor);
  redraw();
}

// Best so far and mean of each cycle against the cycle, both as gaps to the optimum where that is known.
function drawCurve() {
  const { c, width, height, unit } = sized("curve");
  const { optimum } = state.scene;
  const value = (length) => (optimum ? 100 * (length / optimum - 1) : length);
  const rows = state.curve.filter((row) => row[1] != null).map(([cycle, best, mean]) => [cycle, value(best), value(mean)]);
  c.clearRect(0, 0, width, height);
  c.font = `${11 * unit}px system-ui, sans-serif`;
  c.fillStyle = colourOf("quiet");
  if (!rows.length) return c.fillText("Press play.", 4 * unit, 16 * unit);
  const label = (v) => (optimum ? `${v.toFixed(v > 0 && v < 10 ? 1 : 0)} %` : v.toLocaleString("en", { maximumFractionDigits: 0 }));
  const low = optimum ? 0 : rows.at(-1)[1] * 0.98;
  const means = rows.map((row) => row[2]).sort((a, b) => a - b);
  const top = Math.max(rows[0][1], means[Math.floor(means.length * 0.9)], low + (optimum ? 1 : 1e-3 * low));
  const last = Math.max(2, rows.at(-1)[0]);
  const left = 8 * unit + Math.max(...[low, top].map((v) => c.measureText(label(v)).width));
  const x = (cycle) => left + ((width - left - 6 * unit) * Math.log(cycle)) / Math.log(last);
  const y = (v) => height - 20 * unit - ((height - 30 * unit) * (Math.min(v, top * 1.02) - low)) / (top - low);
  c.strokeStyle = colourOf("edge");
  c.lineWidth = unit;
  c.textBaseline = "middle";
  c.textAlign = "right";
  for (const v of [low, (low + top) / 2, top]) {
    c.fillText(label(v), left - 5 * unit, y(v));
    c.beginPath();
    c.moveTo(left, y(v));
    c.lineTo(width, y(v));
    c.stroke();
  }
  c.textAlign = "center";
  for (let cycle = 1, free = -Infinity; cycle <= last; cycle *= 10) if (x(cycle) > free) c.fillText(cycle.toLocaleString("en"), x(cycle) + (cycle === 1 ? 4 * unit : 0), height - 7 * unit), (free = x(cycle) + 40 * unit);
  for (const [k, colour, thick] of [[2, "prediction", 1], [1, "robot", 2.2]]) {
    c.beginPath();
    for (const row of rows) c.lineTo(x(row[0]), y(row[k]));
    c.strokeStyle = colourOf(colour);
    c.lineWidth = thick * unit;
    c.stroke();
  }
  c.beginPath();
  c.arc(x(rows.at(-1)[0]), y(rows.at(-1)[1]), 3.5 * unit, 0, 2 * Math.PI);
  c.fillStyle = colourOf("robot");
  c.fill();
  if (optimum) {
    c.setLineDash([5 * unit, 4 * unit]);
    c.beginPath();
    c.moveTo(left, y(0));
    c.lineTo(width, y(0));
    c.strokeStyle = colourOf("ink");
    c.lineWidth = 1.4 * unit;
    c.stroke();
    c.setLineDash([]);
  }
}

const redraw = inNextFrame(() => {
  if (!state.scene) return;
  drawMap();
  drawCurve();
  if (state.frame) document.body.dataset.ready = "true";
});

// ---- controls ----
function build() {
  byId("speed").replaceChildren(...choices.speeds.map((speed) => make("option", speed > 1000 ? "fastest" : `${speed} cycles/s`, { value: String(speed) })));
  for (const { field, label, options, meaning } of SETTINGS) {
    const row = make("label", "");
    const input = make(options ? "select" : "input", "", { id: `set-${field}` });
    const wrong = make("span", "", { className: "wrong" });
    wrong.setAttribute("role", "alert");
    if (options) input.replaceChildren(...options.map((name) => make("option", name, { value: name })));
    else input.inputMode = "numeric";
    row.append(make("span", label), input, wrong, make("small", meaning));
    byId("settings").append(row);
    setting(field, input, wrong, options ? String : numberOf, request);
  }
}

function listen() {
  const on = (id, kind, action) => byId(id).addEventListener(kind, action);
  const actions = {
    play: () => (working(), request({ op: "play", on: !state.frame?.playing })), step: () => (working(), request({ op: "step" })), reset: () => request({ op: "reset" }),
    "save-tour": () => request({ op: "export", what: "tour" }),
    "save-png": () => byId("map").toBlob((blob) => save(blob, `antway-${stemOf(state.scene.name)}.png`)),
  };
  for (const [id, action] of Object.entries(actions)) on(id, "click", action);
  on("instance", "change", (event) => request({ op: "instance", name: event.target.value }));
  on("speed", "change", (event) => request({ op: "speed", speed: Number(event.target.value) }));
  on("settings", "submit", (event) => event.preventDefault());
  on("map", "click", (event) => {
    const { width, height } = event.target.getBoundingClientRect();
    state.cursor = null;
    press(laid(width, height, MARGIN).from(pointOn(event.target, event)));
  });
  on("map", "keydown", pressKey);
  on("map", "blur", () => ((state.cursor = null), redraw()));
  takeFiles((files) => request({ op: "open", files }));
  for (const id of ["map", "curve"]) new ResizeObserver(redraw).observe(byId(id));
  const faster = (by) => {
    const speed = choices.speeds[choices.speeds.indexOf(state.frame?.speed) + by];
    if (speed) request({ op: "speed", speed });
  };
  listenToKeys((key, event, onButton) => {
    if (event.ctrlKey || event.metaKey) return null;
    const idle = byId("play").disabled;
    const keys = {
      " ": onButton ? null : () => idle || actions.play(), arrowright: () => idle || actions.step(), r: actions.reset, "+": () => faster(1), "-": () => faster(-1),
      t: changeTheme, escape: () => (closeMenu(), document.body.dataset.lost || notice("")),
    };
    return keys[key] ?? (/^\d$/.test(key) && toggle(Number(key)));
  });
}

const closeMenu = menus();
const toggle = boxes(LAYERS, state.show, redraw, mark);
const changeTheme = themes(redraw);
build();
listen();
tips();
