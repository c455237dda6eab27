// Edits are kept in this browser, and offered when the page is opened again.
import { byId } from "/common.js";
import { notice } from "/parts.js";

const KEY = "antway-edits";
const EDITS = ["set", "paint", "move", "drop", "stop", "remove", "open", "undo", "redo"];
const PAUSE = 1000; // ms without an edit after which the scenario is asked for

// `request` asks the server, `open({data, policies})` opens what was kept.
class Keeper {
  constructor(request, open) {
    [this.request, this.edited, this.timer] = [request, false, 0];
    byId("restore").addEventListener("click", () => (this.close(), open(this.offered)));
    byId("forget").addEventListener("click", () => (this.close(), localStorage.removeItem(KEY)));
  }

  close() {
    byId("kept").hidden = true;
  }

  // Note a request: edits are kept from the first on, and given up where another scene is chosen.
  saw(op) {
    if (EDITS.includes(op)) this.edited = true;
    if (op !== "scene") return;
    this.edited = false;
    localStorage.removeItem(KEY);
  }

  // Note that the scenario is another one.
  changed() {
    clearTimeout(this.timer);
    if (this.edited) this.timer = setTimeout(() => this.edited && this.request({ op: "export", what: "keep" }), PAUSE);
  }

  keep({ name, policies, data }) {
    try {
      localStorage.setItem(KEY, JSON.stringify({ name, policies, data, at: Date.now() }));
    } catch (error) {
      if (!this.said) notice(`This browser does not keep the edits: ${error.message}`);
      this.said = true;
    }
  }

  offer() {
    const kept = localStorage.getItem(KEY);
    if (!kept) return;
    this.offered = JSON.parse(kept);
    const when = new Date(this.offered.at).toLocaleString([], { day: "numeric", month: "short", hour: "numeric", minute: "2-digit" });
    byId("kept").firstElementChild.textContent = `Edits of “${this.offered.name || "a scenario"}”, ${when}, are kept here.`;
    byId("kept").hidden = false;
  }
}

export { Keeper };
