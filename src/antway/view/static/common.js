// What replay pages and live pages share: elements, numbers as text, packed data, frames, files, themes, and the layers' boxes.

const byId = (id) => document.getElementById(id);
const make = (tag, text, properties = {}) => Object.assign(document.createElement(tag), { textContent: text, ...properties });
const fixed = (value, digits, unit) => (value == null || !Number.isFinite(value) ? "–" : `${value.toFixed(digits)} ${unit}`.trim());
const bits = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

// Where an event happened on an element, in pixels of the page from its upper left corner.
function pointOn(element, event) {
  const box = element.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

// Returns what asks for `draw(time)` in the next frame; asked several times before that, it draws once.
function inNextFrame(draw) {
  let queued = false;
  return () => {
    if (queued) return;
    queued = true;
    requestAnimationFrame((time) => ((queued = false), draw(time)));
  };
}

function save(blob, name) {
  const link = make("a", "", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

function showPlaying(playing) {
  byId("play").setAttribute("aria-label", playing ? "Pause" : "Play");
  byId("play").classList.toggle("playing", playing);
}

// The colour of an action: of calm, of a planned detour, or of anything else.
function kindOf(action) {
  if (!action || ["follow", "arrived"].includes(action)) return "calm";
  return ["avoid", "step-aside", "step-back"].includes(action) ? "planned" : "prediction";
}

// What a decision, if there is one, is about and how it was weighed, as pairs of a name and a value.
function factsOf(decision) {
  const facts = [];
  if (decision?.obstacle != null) facts.push([`Obstacle ${decision.obstacle}`, (decision.encounter ?? "").replace("crossing-", "crossing from the ")]);
  if (decision?.closest?.[0] != null) facts.push(["Closest approach", `${fixed(Math.max(decision.closest[1], 0), 2, "m")} in ${fixed(decision.closest[0], 1, "s")}`]);
  if (decision?.guard) facts.push(["Guard", decision.guard.replaceAll("-", " ")]);
  if (decision?.gap != null) facts.push(["Certified gap", fixed(100 * decision.gap, 2, "%")]);
  return [...facts, ...(decision?.alternatives ?? [])];
}

// Light or dark, at first as the system prefers; `changed` is called after each change. Returns the switch.
function themes(changed) {
  const root = document.documentElement;
  const set = (theme) => {
    root.dataset.theme = theme;
    byId("theme").setAttribute("aria-pressed", String(theme === "dark"));
    changed();
  };
  set(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  const change = () => set(root.dataset.theme === "dark" ? "light" : "dark");
  byId("theme").addEventListener("click", change);
  return change;
}

// A box with a legend for each of `layers`, kept in `show`, and what `beside` gives for its label; `changed` is called after each
// change. Returns toggle(number of the key).
function boxes(layers, show, changed, beside) {
  const row = ({ key, label, swatch }, i) => {
    const both = make("div", "", { className: "layer" });
    const line = make("label", "", { title: `Key ${(i + 1) % 10}` });
    const box = make("input", "", { type: "checkbox", id: `layer-${key}`, checked: show[key] });
    box.addEventListener("change", () => ((show[key] = box.checked), changed()));
    line.append(box, make("span", "", { className: `swatch ${swatch} of-${key}` }), make("span", label));
    both.append(line, beside(label));
    return both;
  };
  byId("layers").replaceChildren(...layers.map(row));
  return (digit) => {
    const layer = layers[(digit + 9) % 10];
    return layer && (() => byId(`layer-${layer.key}`).click());
  };
}

export { bits, boxes, byId, factsOf, fixed, inNextFrame, kindOf, make, pointOn, save, showPlaying, themes };
