// One policy's part of the page: its stage, its card of decisions, and the record of its run.
import { Stage, navigate } from "/canvas.js";
import { byId, factsOf, fixed, kindOf, make, pointOn } from "/common.js";
import { CYCLE, named } from "/terms.js";
import { choices, shadeMask } from "/parts.js";

const inMs = (ms) => fixed(ms, ms < 10 ? 2 : 0, "ms");

class View {
  // `page` is as in page.js, `editor` takes gestures on the stage.
  constructor(page, editor) {
    [this.page, this.editor] = [page, editor];
    this.figure = byId("view-template").content.firstElementChild.cloneNode(true);
    this.card = byId("card-template").content.firstElementChild.cloneNode(true);
    this.card.querySelector(".cycle span").dataset.tip = CYCLE;
    byId("views").append(this.figure);
    byId("cards").append(this.card);
    this.select = this.figure.querySelector("select");
    this.select.replaceChildren(...choices.policies.map((name) => make("option", name, { value: name })));
    for (const option of this.select.options) option.title = choices.about[option.value];
    this.select.addEventListener("change", () => page.askPolicies());
    this.stage = new Stage(this.figure.querySelector("canvas"));
    this.stage.unit = window.devicePixelRatio || 1;
    const [canvas, place] = [this.stage.canvas, this.figure.querySelector(".place")];
    canvas.addEventListener("pointermove", (event) => {
      const [x, y] = this.stage.toWorld(...pointOn(canvas, event));
      place.textContent = `${fixed(x, 2, "m")}, ${fixed(y, 2, "m")}`;
    });
    canvas.addEventListener("pointerleave", () => (place.textContent = ""));
    editor.listen(this);
    navigate(this.stage, () => (page.align(this.stage), page.redraw()));
    this.observer = new ResizeObserver(page.redraw);
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
    [this.trail, this.ms, this.driven, this.decision, this.pheromone, this.trails] = [[], [], [0], null, null, []]; // of all moments played
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
      this.trails = record.trails;
      this.pheromone = record.decision?.pheromone ? shadeMask(record.decision.pheromone, 215) : null;
    }
    this.describe();
  }

  // The moment that the stage draws, interpolated between the last two frames so that motion is smooth at any frame rate.
  moment(time) {
    const { now, before, decision, page } = this;
    const { scene } = page;
    const span = before && page.playing && !now.outcome ? now.t - before.t : 0;
    const fraction = span > 0 ? Math.min(1, (((time - this.arrived) / 1000) * page.speed) / span) : 1;
    const mix = (a, b) => (fraction < 1 ? a + (b - a) * fraction : b);
    const [x, y] = [0, 1].map((k) => mix(before?.robot[k], now.robot[k]));
    const obstacles = now.obstacles.map(([ox, oy, vx, vy, sensed], id) => ({
      id, vx, vy, radius: scene.radii[id], sensed: Boolean(sensed), focus: decision?.obstacle === id,
      x: mix(before?.obstacles[id]?.[0], ox), y: mix(before?.obstacles[id]?.[1], oy),
    }));
    const gesture = this.editor.gesture?.kind === "end" ? this.editor.gesture : null;
    const ends = { start: scene.start, goal: scene.goal, ...(gesture && { [gesture.end]: gesture.xy }) };
    const visited = now.visited ?? [];
    const stops = [
      ...visited.map(([stop, late], k) => ({ at: scene.stops[stop], number: k + 1, done: true, late })),
      ...(now.order ?? []).map((stop, k) => ({ at: scene.stops[stop], number: visited.length + k + 1, done: false, late: false })),
    ];
    const step = fraction < 1 ? Math.floor(mix(before.at, now.at)) : now.at; // a frame may come several cycles after the last
    const trail = [...this.trail.slice(0, step + 1), ...(fraction < 1 ? [[x, y]] : [])];
    const [distance, direction, stoppingTime] = now.braking;
    return {
      ...ends, obstacles, stops, trail, tolerance: scene.tolerance, global: scene.shortest, planned: decision?.path, target: decision?.target,
      tubes: now.tubes.map(([radius, growth, knots]) => ({ radius, growth, path: knots })), trails: this.trails, pheromone: this.pheromone,
      field: page.field, braking: { distance, direction, stoppingTime, fastest: scene.fastest, acceleration: scene.acceleration ?? Infinity }, moving: fraction < 1,
      robot: { x, y, heading: now.robot[2], radius: scene.radius, range: scene.range ?? Infinity, occlusion: scene.occlusion },
    };
  }

  draw(time) {
    this.stage.resize();
    if (!this.now) return false;
    const { page, editor } = this;
    const moment = this.moment(time);
    this.shown = moment.obstacles;
    this.stage.draw(moment, page.show);
    this.rule();
    const own = ["paint", "waypoints"].includes(editor.gesture?.kind) || editor.gesture?.view === this ? editor.gesture : null;
    editor.draw(this.stage, page.pending ?? own);
    return moment.moving;
  }

  // A bar of a round length, at most 110 pixels long.
  rule() {
    const metre = this.stage.scale / this.stage.unit;
    if (metre === this.ruled || !(metre > 0)) return;
    this.ruled = metre;
    const most = 110 / metre;
    const ten = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].find((n) => n * ten <= most) * ten;
    const ruler = this.figure.querySelector(".ruler");
    ruler.style.width = `${length * metre}px`;
    ruler.textContent = `${Number(length.toPrecision(2))} m`;
  }

  describe() {
    const { now, decision, card, figure } = this;
    const outcome = figure.querySelector(".outcome");
    outcome.hidden = !now.outcome;
    outcome.textContent = (now.outcome ?? "").replaceAll("-", " ");
    outcome.title = now.ending;
    outcome.dataset.good = String(now.outcome === "reached");
    const driven = this.driven[now.at] ?? 0;
    figure.querySelector(".numbers").textContent =
      `${fixed(now.t, 1, "s")} · ${fixed(driven, 1, "m driven")} · ${fixed(now.speed, 2, "m/s")} · nearest ${fixed(now.clearance, 2, "m")}`;
    this.select.title = choices.about[this.select.value];
    this.stage.canvas.setAttribute("aria-label", `Map with the robot steered by ${this.select.value}; the panel says in words what it does.`);
    card.querySelector("h2").textContent = this.page.views.length > 1 ? `Decision of ${this.select.value}` : "Decision";
    const action = card.querySelector(".action");
    action.textContent = now.outcome ? now.outcome.replaceAll("-", " ") : (decision?.action.replaceAll("-", " ") ?? "ready");
    action.dataset.kind = kindOf(decision?.action);
    card.querySelector(".ants").textContent = now.ants ? `Ant cycle ${now.ants[0]} of the control cycle to come${now.ants[1] ? ", the last" : ""}` : now.idle;
    card.querySelector(".reason").textContent = now.outcome ? now.ending : (decision?.reason ?? "Press play, or take one step.");
    const facts = factsOf(decision);
    if (decision?.colony) {
      const [cycles, best, arrived] = decision.colony;
      facts.push([`Ants, after ${cycles} ${cycles === 1 ? "cycle" : "cycles"}`, `${fixed(best, 2, "m")}, ${fixed(100 * arrived, 0, "%")} arrive`]);
    }
    const list = card.querySelector(".facts");
    const names = facts.map(([name]) => name).join();
    if (names !== list.dataset.names) list.replaceChildren(...facts.flatMap(([name]) => [named("dt", name), make("dd", "")])); // what is pointed at stays
    list.dataset.names = names;
    facts.forEach(([, value], i) => (list.children[2 * i + 1].textContent = value));
    this.spark();
  }

  // The policy's time for each of the last cycles, on a logarithmic scale that starts at 0.01 ms.
  spark() {
    const canvas = this.card.querySelector(".spark");
    const last = this.ms.slice(Math.max(0, this.now.at - 120), this.now.at);
    const worst = Math.max(...last);
    const top = Math.max(worst, 0.1);
    [canvas.width, canvas.height] = [240, 56];
    const c = canvas.getContext("2d");
    c.fillStyle = this.stage.colour.robot;
    last.forEach((ms, i) => {
      const high = Math.max(2, (54 * Math.log(Math.max(ms, 0.01) / 0.01)) / Math.log(top / 0.01));
      c.fillRect(i * 2, 56 - high, 1.6, high);
    });
    this.card.querySelector(".cycle span").textContent = last.length ? `cycle ${inMs(last.at(-1))}, worst of ${last.length}: ${inMs(worst)}` : "";
  }
}

export { View };
