import { LAYERS } from "/canvas.js";
import { bits, boxes, byId, fixed, inNextFrame, make, save, showPlaying, themes } from "/common.js";
import { Editor } from "/edit.js";
import { Keeper } from "/keep.js";
import { mark, tips } from "/terms.js";
import { View } from "/view.js";
import {
  busy, choices, choose, connect, listenToKeys, mask, menus, notice, numberOf, refuse, setting, shadeMask, showSettings, stemOf, takeFiles, working,
} from "/parts.js";

const redraw = inNextFrame((time) => {
  const moving = page.views.map((view) => view.draw(time));
  if (page.views.length && page.views.every((view) => view.now)) document.body.dataset.ready = "true"; // nothing moves under a finger any more
  if (moving.includes(true)) redraw();
});
const page = {
  scene: null, field: null, views: [], tool: "hand", brush: 1, size: 0.3, pace: 0.5, pending: null, playing: false, speed: 1, at: 0, steps: 0,
  show: Object.fromEntries(LAYERS.map(({ key, off }) => [key, !off])),
  request: (message) => request(message), redraw, align, obstacleAt, askPolicies, setDone, notice,
};
const editor = new Editor(page);
const send = connect("/live", (message) => {
  if (message.kind === "frame") takeFrame(message);
  if (message.kind === "scene") takeScene(message);
  if (message.kind === "link") showLink(message.hash);
  if (message.kind === "kept") keeper.keep(message);
  if (message.kind === "refused") takeRefusal(message);
});
const request = (message) => (keeper.saw(message.op), send(message));
const keeper = new Keeper(send, (kept) => openScenario(kept.data, kept.policies));

// ---- what comes from the server ----
function takeScene(scene) {
  const { map } = scene;
  for (const name of ["blocked", "unknown"]) {
    if (!map[name]) continue;
    const packed = bits(map[name]);
    map[name] = mask(map.rows, map.cols, (i) => ((packed[i >> 3] >> (i & 7)) & 1) * 255);
  }
  const sameMap = page.scene && ["rows", "cols", "resolution", "x", "y", "top_first"].every((key) => page.scene.map[key] === map[key]);
  page.scene = scene;
  page.field = scene.field && shadeMask(scene.field, 150);
  page.pending = null;
  document.documentElement.style.setProperty("--ratio", String(map.rows / map.cols));
  buildViews(scene.policies);
  for (const view of page.views) {
    view.reset();
    if (sameMap && view.stage.map) view.stage.change(map);
    else view.stage.setMap(map);
  }
  if (sameMap) align(page.views[0].stage);
  choose("scene", choices.scenes, scene.name);
  document.title = `${scene.name} – antway`;
  byId("undo").disabled = !scene.undo;
  byId("redo").disabled = !scene.redo;
  byId("compare").setAttribute("aria-pressed", String(scene.policies.length > 1));
  byId("pace").max = String(scene.fastest);
  if (page.pace > scene.fastest) byId("pace").value = String((page.pace = scene.fastest));
  const typing = document.activeElement === byId("size");
  if (!page.dropped && !typing && scene.radii.length) byId("size").value = String((page.size = scene.radii[0]));
  showSettings(scene.parameters);
  if (!page.begun) begin();
  keeper.changed();
  redraw();
}

function begin() {
  page.begun = true;
  openAddress();
  addEventListener("hashchange", openAddress); // a link that is pasted into an open tab
  keeper.offer();
}

function takeRefusal(message) {
  page.pending = null;
  refuse(message);
  redraw();
}

function takeFrame(frame) {
  request({ op: "seen" });
  page.playing = frame.playing;
  page.speed = frame.speed;
  frame.views.forEach((record, i) => page.views[i].take(record));
  showPlaying(frame.playing);
  byId("speed").value = String(frame.speed);
  [page.at, page.steps] = [frame.at, frame.steps];
  const over = page.views.every((view) => view.now.outcome);
  for (const id of ["play", "step", "ants"]) byId(id).disabled = over;
  byId("back").disabled = frame.at === 0;
  const scrub = byId("scrub");
  scrub.max = String(frame.steps);
  scrub.disabled = frame.steps === 0;
  if (!scrub.matches(":active")) scrub.value = String(frame.at);
  scrub.setAttribute("aria-valuetext", `${fixed(frame.at * page.scene.dt, 1, "s")} of ${fixed(frame.steps * page.scene.dt, 1, "s")}`);
  byId("cards").setAttribute("aria-live", frame.playing ? "off" : "polite");
  busy("");
  byId("time").textContent = fixed(Math.max(...page.views.map((view) => view.now.t)), 1, "s");
  redraw();
}

// ---- the views ----
function buildViews(policies) {
  while (page.views.length > policies.length) page.views.pop().remove();
  while (page.views.length < policies.length) page.views.push(new View(page, editor));
  policies.forEach((name, i) => (page.views[i].select.value = name));
}

// Show the same part of the map on every stage.
function align(from) {
  for (const { stage } of page.views) if (stage !== from) [stage.zoom, stage.centre] = [from.zoom, [...from.centre]];
}

function obstacleAt(view, [x, y], within) {
  const distance = ({ x: ox, y: oy, radius }) => Math.hypot(ox - x, oy - y) - radius;
  const near = (view.shown ?? []).filter((o) => distance(o) <= within).sort((a, b) => distance(a) - distance(b));
  return near.length ? near[0].id : -1;
}

// ---- controls ----

// Request these policies; without names, those that the choosers of the views show.
function askPolicies(names = page.views.map((view) => view.select.value)) {
  busy("preparing …");
  request({ op: "policies", names });
}

function setTool(tool) {
  page.tool = tool;
  editor.drop();
  setDone(false);
  byId("done").hidden = tool !== "waypoints";
  document.querySelector("main").dataset.tool = tool;
  for (const button of document.querySelectorAll("[data-tool]:not(main)")) button.setAttribute("aria-pressed", String(button.dataset.tool === tool));
  const brushing = tool === "wall" || tool === "erase";
  const dropping = tool === "obstacle" || tool === "waypoints";
  for (const [id, on] of [["brush", brushing], ["size", dropping], ["pace", tool === "waypoints"]]) byId(`${id}-label`).hidden = !on;
}

// Show the button that ends a sequence of waypoints; its space is always kept, so that the map does not move under the finger.
function setDone(shown) {
  byId("done").style.visibility = shown ? "visible" : "hidden";
}

function showLink(hash) {
  const address = `${location.origin}/#${hash}`;
  byId("link").value = address;
  byId("link-box").showModal();
  byId("link").select();
}

// Ask whether to open what the address holds after its #: the names of policies, and a scenario's file. Any site can offer such a link.
function openAddress() {
  const named = new URLSearchParams(location.hash.slice(1));
  if (!named.has("open")) return;
  history.replaceState(null, "", location.pathname + location.search);
  page.offered = { data: named.get("open").replaceAll("-", "+").replaceAll("_", "/"), policies: named.get("policies") };
  byId("ask-size").textContent = fixed((page.offered.data.length * 3) / 4096, 1, "kB");
  if (!byId("ask-box").open) byId("ask-box").showModal();
}

function openOffered() {
  const { data, policies } = page.offered;
  byId("ask-box").close();
  openScenario(data + "=".repeat((4 - (data.length % 4)) % 4), policies?.split(","));
}

// Open a scenario's file, and drive it with these policies.
function openScenario(data, policies) {
  busy("opening …");
  request({ op: "open", files: [{ name: "scenario.zip", data }] });
  if (policies) request({ op: "policies", names: policies });
}

// Show the moment that the slider is at; it moves more often than the server takes requests.
let scrubbing = 0;
function scrub() {
  scrubbing ||= setTimeout(() => {
    scrubbing = 0;
    request({ op: "at", step: Number(byId("scrub").value) });
  }, 60);
}

// Open files. A map's description without its picture is refused; for a picture without a description, the size of a pixel is asked for.
function openFiles(files) {
  const ends = (...kinds) => files.find(({ name }) => kinds.some((kind) => name.toLowerCase().endsWith(kind)));
  const open = () => request({ op: "open", files });
  const image = ends(".png", ".pgm");
  if (ends(".toml", ".zip", ".map", ".txt", ".npy")) return open();
  if (ends(".yaml", ".yml") && !image) return busy(""), notice(`${files[0].name} is the description of a map: choose its picture too`);
  if (!image || ends(".yaml", ".yml")) return open();
  busy("");
  notice("");
  page.pictured = { files, image };
  byId("pixel-box").showModal();
}

// Open the picture with the size of a pixel that the user gave.
function openPicture() {
  if (!sized()) return;
  byId("pixel-box").close();
  busy("opening …");
  Object.assign(page.pictured.image, { resolution: Number(byId("pixel").value), occupied: Number(byId("occupied").value) });
  request({ op: "open", files: page.pictured.files });
}

function sized() {
  const share = Number(byId("occupied").value);
  const right = { pixel: Number(byId("pixel").value) > 0, occupied: Number.isInteger(share) && share >= 1 && share <= 100 };
  for (const id in right) byId(id).setAttribute("aria-invalid", String(!right[id]));
  return right.pixel && right.occupied;
}

function picture() {
  const canvases = page.views.map((view) => view.stage.canvas);
  const whole = make("canvas", "", { width: canvases.reduce((sum, c) => sum + c.width, 0), height: canvases[0].height });
  const c = whole.getContext("2d");
  c.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--page");
  c.fillRect(0, 0, whole.width, whole.height);
  canvases.reduce((left, canvas) => (c.drawImage(canvas, left, 0), left + canvas.width), 0);
  whole.toBlob((blob) => save(blob, `antway-${stemOf(page.scene.name)}.png`));
}

function faster(by) {
  const at = choices.speeds.indexOf(page.speed) + by;
  if (choices.speeds[at] !== undefined) request({ op: "speed", speed: choices.speeds[at] });
}

// Read a number of the palette if it is within its range.
function setNumber(input, name) {
  const value = Number(input.value);
  const right = input.value.trim() !== "" && value >= Number(input.min) && value <= Number(input.max);
  input.setAttribute("aria-invalid", String(!right));
  if (!right) return notice(`${input.ariaLabel} = ${input.value || "nothing"}: must be from ${input.min} to ${input.max}`);
  notice("");
  page[name] = value;
  page.dropped = true;
}

function build() {
  byId("speed").replaceChildren(...choices.speeds.map((speed) => make("option", `${speed}×`, { value: String(speed) })));
  for (const parameter of choices.parameters) {
    const { field: name, label, unit, low, high, meaning } = parameter;
    if (name === "seed") {
      setting(name, byId("seed"), make("span", ""), numberOf, request);
      byId("seed").title = meaning;
    }
    const row = make("label", "");
    const input = make("input", "", { inputMode: "decimal", id: `parameter-${name}` });
    const wrong = make("span", "", { className: "wrong", id: `wrong-${name}` });
    wrong.setAttribute("role", "alert");
    input.setAttribute("aria-describedby", wrong.id);
    row.append(make("span", unit ? `${label}, ${unit}` : label), input, wrong, make("small", `${meaning} ${low} to ${high}${unit && ` ${unit}`}.`));
    byId("parameters").append(row);
    setting(name, input, wrong, numberOf, request);
  }
}

function listen() {
  const on = (id, kind, action) => byId(id).addEventListener(kind, action);
  const play = () => byId("play").disabled || (working(), request({ op: "play", on: !page.playing }));
  const actions = {
    play, step: () => (working(), request({ op: "step" })), back: () => request({ op: "at", step: Math.max(0, page.at - 1) }), ants: () => (busy("looking …"), request({ op: "ants" })), reset: () => request({ op: "reset" }), undo: () => request({ op: "undo" }), redo: () => request({ op: "redo" }),
    help: () => { byId("keys").open = !byId("keys").open; if (byId("keys").open) byId("keys").scrollIntoView({ block: "nearest" }); },
    done: () => editor.finish(), fit: () => { for (const { stage } of page.views) stage.fit(); redraw(); },
    compare: () => askPolicies(page.views.length > 1 ? [page.views[0].select.value] : [page.views[0].select.value, page.views[0].select.value === "paper" ? "antway" : "paper"]),
    "save-png": picture,
  };
  for (const what of ["scenario", "link", "replay", "gif"]) actions[`save-${what}`] = () => (busy("writing …"), request({ op: "export", what }));
  actions["save-trace"] = () => (busy("writing …"), page.views.forEach((_, view) => request({ op: "export", what: "trace", view })));
  for (const [id, action] of Object.entries(actions)) on(id, "click", action);
  on("scene", "change", (event) => (busy("opening …"), request({ op: "scene", name: event.target.value })));
  on("speed", "change", (event) => request({ op: "speed", speed: Number(event.target.value) }));
  on("brush", "change", (event) => (page.brush = Number(event.target.value)));
  for (const id of ["size", "pace"]) on(id, "change", (event) => setNumber(event.target, id));
  on("copy", "click", async () => {
    byId("link").select();
    await navigator.clipboard?.writeText(byId("link").value).catch(() => {});
    byId("copy").textContent = "Copied";
  });
  on("ask-open", "click", openOffered);
  on("ask-drop", "click", () => byId("ask-box").close());
  for (const id of ["pixel", "occupied"]) on(id, "input", sized);
  on("scrub", "input", scrub);
  on("pixel-open", "click", openPicture);
  on("pixel-box", "keydown", (event) => event.key === "Enter" && event.target.id !== "pixel-drop" && (event.preventDefault(), byId("pixel-open").click()));
  on("pixel-drop", "click", () => byId("pixel-box").close());
  on("close-link", "click", () => byId("link-box").close());
  on("link-box", "close", () => (byId("copy").textContent = "Copy"));
  on("parameters", "submit", (event) => event.preventDefault());
  takeFiles(openFiles);
  for (const button of document.querySelectorAll(".palette [data-tool]")) button.addEventListener("click", () => setTool(button.dataset.tool));
  const tools = { v: "hand", w: "wall", e: "erase", o: "obstacle", p: "waypoints", s: "stop" };
  listenToKeys((key, event, onButton) => {
    if (["link-box", "ask-box", "pixel-box"].some((id) => byId(id).open)) return null;
    if (event.ctrlKey || event.metaKey) return key === "z" && (() => byId(event.shiftKey ? "redo" : "undo").click());
    const keys = {
      " ": onButton ? null : actions.play, arrowright: () => byId("step").disabled || actions.step(), arrowleft: () => byId("back").disabled || actions.back(), a: () => byId("ants").disabled || actions.ants(), r: actions.reset, "+": () => faster(1), "-": () => faster(-1),
      enter: onButton || !editor.gesture ? null : actions.done, "?": actions.help, f: actions.fit, t: changeTheme, c: actions.compare, escape: () => (closeMenu(), editor.drop(), document.body.dataset.lost || notice("")),
    };
    return keys[key] ?? (tools[key] ? () => setTool(tools[key]) : /^\d$/.test(key) && toggle(Number(key)));
  });
}

const closeMenu = menus();
const toggle = boxes(LAYERS, page.show, redraw, mark);
const changeTheme = themes(() => {
  for (const { stage } of page.views) stage.refresh();
  redraw();
});
build();
listen();
tips();
setTool("hand");
