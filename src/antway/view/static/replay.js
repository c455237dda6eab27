import { HORIZON, LAYERS, Stage, navigate } from "./canvas.js";
import { bits, boxes, byId, factsOf, fixed, inNextFrame, kindOf, make, save, showPlaying, themes } from "./common.js";

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8];
const SHOWN = LAYERS.filter(({ live }) => !live);

// ---- episodes, unpacked ----
const bytes = (text) => bits(text).buffer;

class View {
  constructor(data, canvas) {
    this.data = data;
    this.stage = new Stage(canvas);
    this.t = new Float32Array(bytes(data.t));
    this.last = this.t.length - 1;
    this.robotXY = this.points(data.robot.xy);
    this.driven = new Float32Array(bytes(data.driven)); // m; until each step
    this.speed = new Float32Array(bytes(data.speed)); // m/s; at the end of each step
    this.clearance = new Float32Array(bytes(data.clearance)); // m; from the robot's outline to the nearest moving obstacle
    this.heading = new Float32Array(bytes(data.robot.heading));
    this.count = data.obstacles.id.length;
    this.obstacleXY = this.points(data.obstacles.xy, data.obstacles.box); // [step * count + k]
    this.sensed = new Uint8Array(bytes(data.obstacles.sensed)); // one bit each, in the same order
    this.global = data.global ? this.points(data.global) : [];
    for (const decision of data.decisions) {
      if (decision.path) decision.path = this.points(decision.path);
      if (decision.predicted) decision.predicted = new Float32Array(bytes(decision.predicted)); // [7 * part + column]
    }
    this.decisionOf = new Int32Array(this.last + 1).fill(-1);
    for (let i = 0, d = -1; i <= this.last; i++) {
      while (d + 1 < data.decisions.length && data.decisions[d + 1].step <= i) d++;
      this.decisionOf[i] = d;
    }
  }

  points(text, box = this.data.box) {
    const raw = new Uint16Array(bytes(text));
    const { x, y, width, height } = box;
    return Array.from({ length: raw.length / 2 }, (_, i) => [
      x + (raw[2 * i] / 65535) * width,
      y + (raw[2 * i + 1] / 65535) * height,
    ]);
  }

  decision(step) {
    return this.data.decisions[this.decisionOf[Math.min(step, Math.max(this.last - 1, 0))]];
  }

  isSensed(step, k) {
    const bit = step * this.count + k;
    return ((this.sensed[bit >> 3] >> (bit & 7)) & 1) === 1;
  }

  stepAt(time) {
    let [low, high] = [0, this.last];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.t[middle] <= time + 1e-6) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  // Everything that the stage draws at a time between two steps; motion within a step is straight.
  momentAt(time) {
    const { data, t, count, obstacleXY, robotXY } = this;
    const i = this.stepAt(time);
    const j = Math.min(i + 1, this.last);
    const dt = t[j] - t[i];
    const fraction = dt > 0 ? Math.min(1, Math.max(0, (time - t[i]) / dt)) : 0;
    const mix = (a, b) => [a[0] + (b[0] - a[0]) * fraction, a[1] + (b[1] - a[1]) * fraction];
    const [x, y] = mix(robotXY[i], robotXY[j]);
    const decision = this.decision(i);
    const obstacles = data.obstacles.id.map((id, k) => {
      const [a, b] = [obstacleXY[i * count + k], obstacleXY[j * count + k]];
      const [ox, oy] = mix(a, b);
      const velocity = dt > 0 ? [(b[0] - a[0]) / dt, (b[1] - a[1]) / dt] : [0, 0];
      const focus = decision?.obstacle === id;
      return { id, x: ox, y: oy, vx: velocity[0], vy: velocity[1], radius: data.obstacles.radius[k], sensed: this.isSensed(i, k), focus };
    });
    const range = data.robot.range ?? Infinity;
    const tubes = predicted(decision?.predicted ?? [], time);
    return {
      step: i, decision, obstacles, start: data.start, goal: data.goal, tolerance: data.tolerance,
      stops: (data.stops ?? []).map(({ at, end, late }, k) => ({ at, late, number: k + 1, done: end != null && end <= time })),
      robot: { x, y, heading: this.heading[i], radius: data.robot.radius, range, occlusion: data.robot.occlusion }, tubes,
      trail: [...robotXY.slice(0, i + 1), [x, y]], global: this.global, planned: decision?.path, target: decision?.target,
      pheromone: decision?.pheromone != null ? data.pheromone[decision.pheromone] : null,
    };
  }

  async unpack() {
    const { map, pheromone } = this.data;
    const [blocked, unknown, ...masks] = await Promise.all([image(map.blocked), image(map.unknown), ...pheromone.map(({ mask }) => image(mask))]);
    masks.forEach((mask, i) => (pheromone[i].mask = mask));
    this.stage.setMap({ ...map, blocked, unknown });
  }
}

// What the policy took obstacles to sweep, from `time` on, as layers.js draws it. Rows: from, to, place and velocity then, radius.
function predicted(rows, time) {
  const tubes = [];
  for (let i = 0; i < rows.length; i += 7) {
    const [from, to, x, y, vx, vy, radius] = rows.slice(i, i + 7);
    const [start, end] = [Math.max(from, time), Math.min(to, time + HORIZON)];
    if (start >= end) continue;
    const path = [start, end].map((t) => [t - time, x + vx * (t - from), y + vy * (t - from)]);
    tubes.push({ radius, growth: 0, path });
  }
  return tubes;
}

const image = async (source) => {
  if (!source) return null;
  const picture = new Image();
  picture.src = source;
  await picture.decode();
  return picture;
};

// ---- state ----
const state = { time: 0, playing: false, speed: 1, show: Object.fromEntries(SHOWN.map(({ key }) => [key, true])) };
const records = JSON.parse(byId("episode").textContent);
const views = [records, ...(records.beside ?? [])].map((data, i) => new View(data, canvasOf(data, i)));
const longest = views.reduce((a, b) => (b.t[b.last] > a.t[a.last] ? b : a)); // whose steps the slider counts
const { t, last } = longest;
let chosen = views[0]; // the panel shows the decisions of this one

// The canvas of an episode. Several stand side by side under their names; a click on a name shows that episode in the panel.
function canvasOf(data, i) {
  const first = byId("stage");
  if (!records.beside) return first;
  const canvas = i ? first.cloneNode() : first;
  if (i) canvas.id = `stage-${i}`;
  const view = make("div", "", { className: "episode" });
  const name = make("button", `${data.policy}: ${data.outcome.replaceAll("-", " ")}`, { type: "button", className: "chosen" });
  name.title = "Show the decisions of this episode";
  name.addEventListener("click", () => choose(views[i]));
  byId("views").append(view);
  view.append(name, canvas);
  return canvas;
}

function choose(view) {
  chosen = view;
  document.querySelectorAll(".chosen").forEach((name, i) => name.setAttribute("aria-pressed", String(views[i] === view)));
  put("subtitle", `policy ${view.data.policy}, seed ${view.data.seed}`);
  put("outcome", view.data.outcome.replaceAll("-", " "));
  byId("outcome").dataset.good = String(view.data.outcome === "reached");
  byId("outcome").title = view.data.reason;
  drawRibbon();
  redraw();
}

// ---- the page ----
const put = (id, text) => {
  const element = byId(id);
  if (element.textContent !== text) element.textContent = text;
};

let shownDecision = null;
function showDecision(decision) {
  if (decision === shownDecision) return;
  shownDecision = decision;
  put("action", decision ? decision.action.replaceAll("-", " ") : "–");
  byId("action").dataset.kind = kindOf(decision?.action);
  put("reason", decision?.reason ?? "No decision was recorded.");
  byId("facts").replaceChildren(...factsOf(decision).flatMap(([name, value]) => [make("dt", name), make("dd", value)]));
}

function render() {
  if (views.some(({ stage }) => !stage.map)) return; // pictures are still being unpacked
  for (const { stage } of views) stage.resize();
  const moments = views.map((view) => view.momentAt(state.time));
  views.forEach(({ stage }, i) => stage.draw(moments[i], state.show));
  const moment = moments[views.indexOf(chosen)];
  const { step } = moment;
  showDecision(moment.decision);
  put("time", `${state.time.toFixed(1)} / ${t[last].toFixed(1)} s`);
  put("speed-now", fixed(chosen.speed[step], 2, "m/s"));
  put("driven", fixed(chosen.driven[step], 2, "m"));
  put("clearance", fixed(chosen.clearance[step], 2, "m"));
  const scrub = byId("scrub");
  if (Number(scrub.value) !== longest.stepAt(state.time)) scrub.value = String(longest.stepAt(state.time));
  scrub.setAttribute("aria-valuetext", `${state.time.toFixed(1)} seconds, ${moment.decision?.action ?? ""}`);
}

const redraw = inNextFrame(render);

let before = 0;
function tick(now) {
  if (!state.playing) return;
  state.time = Math.min(t[last], state.time + (Math.min(100, now - before) / 1000) * state.speed);
  before = now;
  render();
  if (state.time >= t[last]) setPlaying(false);
  else requestAnimationFrame(tick);
}

function setPlaying(playing) {
  if (playing && state.time >= t[last]) state.time = 0;
  state.playing = playing;
  showPlaying(playing);
  byId("decision").setAttribute("aria-live", playing ? "off" : "polite");
  if (playing) {
    before = performance.now();
    requestAnimationFrame(tick);
  }
}

function seek(step) {
  setPlaying(false);
  state.time = t[Math.min(last, Math.max(0, step))];
  redraw();
}

function setSpeed(speed) {
  state.speed = speed;
  byId("speed").value = String(speed);
}

// A ribbon under the slider: one colour for each kind of action.
function drawRibbon() {
  const canvas = byId("ribbon");
  const css = getComputedStyle(document.documentElement);
  const c = canvas.getContext("2d");
  canvas.width = 1000;
  canvas.height = 1;
  for (let x = 0; x < 1000; x++) {
    c.fillStyle = css.getPropertyValue(`--${kindOf(chosen.decision(chosen.stepAt((x / 1000) * t[last]))?.action)}`);
    c.fillRect(x, 0, 1, 1);
  }
}

const toggle = boxes(SHOWN, state.show, redraw, () => "");

function build() {
  const available = {
    global: views[0].global.length > 0,
    pheromone: views.some(({ data }) => data.pheromone.length > 0),
    prediction: views.some(({ data }) => data.decisions.some((decision) => decision.predicted)),
  };
  for (const key in available) {
    if (available[key]) continue;
    byId(`layer-${key}`).disabled = true;
    byId(`layer-${key}`).parentElement.title = "This episode has none.";
  }
  byId("speed").replaceChildren(...SPEEDS.map((speed) => new Option(`${speed}×`, String(speed), speed === 1, speed === 1)));
  put("title", views[0].data.scenario);
  Object.assign(byId("scrub"), { min: "0", max: String(last), step: "1", value: "0" });
}

function listen() {
  byId("play").addEventListener("click", () => setPlaying(!state.playing));
  byId("back").addEventListener("click", () => seek(longest.stepAt(state.time) - 1));
  byId("forward").addEventListener("click", () => seek(longest.stepAt(state.time) + 1));
  byId("first").addEventListener("click", () => seek(0));
  byId("next").addEventListener("click", () => seek(nextEncounter()));
  byId("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
  byId("speed").addEventListener("change", (event) => setSpeed(Number(event.target.value)));
  byId("fit").addEventListener("click", () => (views.forEach(({ stage }) => stage.fit()), redraw()));
  byId("save").addEventListener("click", picture);
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const faster = (by) => setSpeed(SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, SPEEDS.indexOf(state.speed) + by))]);
    const onButton = ["BUTTON", "INPUT", "SUMMARY"].includes(event.target.tagName) && event.target.type !== "range";
    const keys = {
      " ": () => onButton || setPlaying(!state.playing), arrowleft: () => seek(longest.stepAt(state.time) - 1), arrowright: () => seek(longest.stepAt(state.time) + 1),
      home: () => seek(0), end: () => seek(last), n: () => seek(nextEncounter()), "+": () => faster(1), "-": () => faster(-1),
      t: () => byId("theme").click(), f: () => byId("fit").click(), s: picture,
    };
    const action = keys[event.key.toLowerCase()] ?? toggle(Number(event.key));
    if (!action) return;
    if (!(event.key === " " && onButton)) event.preventDefault();
    action();
  });
  new ResizeObserver(redraw).observe(byId("views"));
  for (const { stage } of views) {
    navigate(stage, () => {
      for (const { stage: other } of views) [other.zoom, other.centre] = [stage.zoom, [...stage.centre]]; // all show the same part
      redraw();
    });
  }
}

// The next step at which a decision of another kind begins; after the last one, the first step.
function nextEncounter() {
  const action = (i) => chosen.decision(i)?.action;
  for (let i = chosen.stepAt(state.time) + 1; i < chosen.last; i++)
    if (action(i) !== action(i - 1) && kindOf(action(i)) !== "calm") return longest.stepAt(chosen.t[i]);
  return 0;
}

function picture() {
  chosen.stage.canvas.toBlob((blob) => save(blob, `antway-${state.time.toFixed(1)}s.png`));
}

async function open() {
  build();
  listen();
  await Promise.all(views.map((view) => view.unpack()));
  const { rows, cols } = views[0].data.map;
  document.documentElement.style.setProperty("--ratio", String(rows / cols));
  choose(views[0]);
  themes(() => {
    for (const { stage } of views) stage.refresh();
    drawRibbon();
    redraw();
  });
  setPlaying(false);
  document.body.dataset.ready = "true";
}

open();
