// Edits are kept in this browser, and offered when the page is opened again.
import { byId } from "/common.js";
import { notice } from "/parts.js";

const KEY = "antway-edits";
const EDITS = ["set", "paint", "move", "drop", "stop", "remove", "open", "undo", "redo"];
const PAUSE = 1000; // ms without an edit after which the scenario is asked for

// What is kept, by this tab or by another; null if there is nothing that can be read, or the browser blocks it.
function read() {
  try {
    return JSON.parse(localStorage.getItem(KEY));
  } catch {
    return null;
  }
}

// Remove edits, unless others have been kept since, for instance by another tab.
function remove(edits) {
  if (edits && read()?.at === edits.at) localStorage.removeItem(KEY);
}

// `request` asks the server, `open({data, policies})` opens what was kept.
class Keeper {
  constructor(request, open) {
    [this.request, this.edited, this.timer] = [request, false, 0];
    byId("restore").addEventListener("click", () => (this.close(), open(this.offered)));
    byId("forget").addEventListener("click", () => (this.close(), remove(this.offered)));
  }

  close() {
    byId("kept").hidden = true;
  }

  // Note a request: edits are kept from the first on, and this tab's are given up where another scene is chosen.
  saw(op) {
    if (EDITS.includes(op)) this.edited = true;
    if (op !== "scene") return;
    this.edited = false;
    remove(this.kept);
  }

  // Note that the scenario is another one.
  changed() {
    clearTimeout(this.timer);
    if (this.edited) this.timer = setTimeout(() => this.edited && this.request({ op: "export", what: "keep" }), PAUSE);
  }

  // Keep what the server sent, unless another scene was chosen meanwhile.
  keep({ name, policies, data }) {
    if (!this.edited) return;
    this.kept = { name, policies, data, at: Date.now() };
    try {
      localStorage.setItem(KEY, JSON.stringify(this.kept));
    } catch (error) {
      if (!this.said) notice(`This browser does not keep the edits: ${error.message}`);
      this.said = true;
    }
  }

  offer() {
    const kept = read();
    if (!kept?.data) return;
    this.offered = kept;
    const when = new Date(kept.at).toLocaleString([], { day: "numeric", month: "short", hour: "numeric", minute: "2-digit" });
    byId("kept").firstElementChild.textContent = `Edits of “${kept.name || "a scenario"}”, ${when}, are kept here.`;
    byId("kept").hidden = false;
  }
}

export { Keeper };
