// What the words of the pages mean: shown under the pointer, and under what the keyboard is on.
import { byId, make } from "/common.js";

const TERMS = {
  "Above the optimum": "How much longer the best tour is than the shortest there is.",
  "Ants, after": "The colony of policy paper: the best path of its ants, and how many of them reached their goal.",
  "Ants' trails": "The moves on which ants left the most pheromone. Kept only for the latest moment.",
  "Certified gap": "How much worse than the best plan this one is at most, proved by a lower bound.",
  "Closest approach": "How near the robot and this obstacle come, and when, if both go on as they do now.",
  Cycle: "In a cycle each ant makes a tour, and pheromone fades and is laid anew.",
  "Distance to the goal": "The exact distance over the known map from every cell: the darker the nearer.",
  Guard: "The last check of every command: it passes only if the robot can brake afterwards before it touches anything.",
  "Guard's braking area": "What the robot needs to come to a stand, and how far each sensed obstacle may come until then.",
  "Local target": "Where policy paper rejoins the shortest path behind an obstacle.",
  Obstacle: "How the obstacle is met: head-on, crossing, overtaking, standing.",
  "Pheromone by cell": "What ants leave where answers were good, and follow: the darker the more.",
  "Pheromone on edges": "What ants leave on the edges of good tours, and follow: the thicker the more.",
  Predicted: "Where each obstacle is expected to go, wider the less is known about it.",
  "Sensed range": "How far the robot senses what moves; nothing is sensed behind walls.",
  "Tours made": "How many tours all ants together have made.",
};

const CYCLE = "Time of the policy for one control cycle: sense, decide, drive. The bars are the last 120, on a logarithmic scale.";

// What a text that begins with a term means; undefined if none does. Of two terms, the longer one counts.
const LONGEST_FIRST = Object.keys(TERMS).sort((one, other) => other.length - one.length);
const meaningOf = (text) => TERMS[LONGEST_FIRST.find((term) => text.startsWith(term))];

// An element with this text; if that is a term, its meaning can be asked for.
function named(tag, text) {
  const meaning = meaningOf(text);
  const element = make(tag, meaning ? "" : text);
  if (meaning) element.append(explained(make("span", text), meaning));
  return element;
}

function explained(element, meaning) {
  element.classList.add("term");
  element.tabIndex = 0;
  element.dataset.tip = meaning;
  return element;
}

// A question mark that explains a label, for labels that a press switches, so that they cannot be asked themselves.
function mark(label) {
  const meaning = meaningOf(label);
  if (!meaning) return "";
  const sign = explained(make("span", "?", { className: "mark" }), meaning);
  sign.setAttribute("role", "img");
  sign.setAttribute("aria-label", `What is: ${label}`);
  return sign;
}

// Show meanings under the pointer, and under what the keyboard is on; Escape hides them.
function tips() {
  const tip = byId("tip");
  let of = null;
  const hide = () => {
    of?.removeAttribute("aria-describedby");
    of = null;
    tip.hidden = true;
  };
  const show = (element, text) => {
    hide();
    if (!text) return;
    of = element;
    tip.textContent = text;
    tip.hidden = false;
    element.setAttribute("aria-describedby", "tip");
    const [box, own] = [element.getBoundingClientRect(), tip.getBoundingClientRect()];
    const below = box.bottom + 6 + own.height <= innerHeight;
    tip.style.left = `${Math.max(8, Math.min(box.left, innerWidth - own.width - 8))}px`;
    tip.style.top = `${below ? box.bottom + 6 : Math.max(8, box.top - 6 - own.height)}px`;
  };
  const term = (event) => event.target.closest?.("[data-tip]");
  document.addEventListener("pointerover", (event) => {
    const element = term(event);
    if (element) show(element, element.dataset.tip);
    else if (of && event.pointerType === "mouse" && !of.matches(":focus-visible")) hide();
  });
  document.addEventListener("focusin", (event) => {
    const { target } = event;
    if (term(event)) show(target, target.dataset.tip);
    else if (target.matches(":focus-visible") && target.tagName === "BUTTON") show(target, target.title);
    else hide();
  });
  document.addEventListener("focusout", hide);
  document.addEventListener("scroll", hide, true);
  document.addEventListener("pointerdown", (event) => term(event) || hide());
  document.addEventListener("keydown", (event) => event.key === "Escape" && hide());
  for (const element of document.querySelectorAll("[data-term]")) element.replaceChildren(...named("dt", element.textContent).childNodes);
}

export { CYCLE, explained, mark, named, tips };
