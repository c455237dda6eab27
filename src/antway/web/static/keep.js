// Edits are kept in this browser, and offered when the page is opened again.
import { byId } from "/common.js";
import { notice } from "/parts.js";

const KEY = "antway-edits";
const EDITS = ["set", "paint", "move", "drop", "stop", "remove", "open", "undo", "redo"];
const MOST = 5; // edits kept, each of another tab or of an earlier visit
const PAUSE = 1000; // ms without an edit after which the scenario is asked for

// What this tab and others have kept, the newest first; nothing where that cannot be read, or the browser blocks it.
function read() {
  try {
    const all = [JSON.parse(localStorage.getItem(KEY))].flat();
    return all.filter((edits) => edits?.data).sort((a, b) => b.at - a.at);
  } catch {
    return [];
  }
}

function write(all) {
  if (all.length) localStorage.setItem(KEY, JSON.stringify(all));
  else localStorage.removeItem(KEY);
}

// Remove edits; those that have been kept since, or by other tabs, stay.
function remove(edits) {
  const all = read();
  const others = all.filter(({ at }) => at !== edits?.at);
  if (others.length < all.length) write(others);
}

// `request` asks the server, `open({data, policies})` opens what was kept.
class Keeper {
  constructor(request, open) {
    [this.request, this.edited, this.timer] = [request, false, 0];
    byId("restore").addEventListener("click", () => (this.close(), (this.kept = this.offered), open(this.offered)));
    byId("forget").addEventListener("click", () => (this.close(), remove(this.offered), this.offer()));
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
    this.kept = null;
  }

  // Note that the scenario is another one.
  changed() {
    clearTimeout(this.timer);
    if (this.edited) this.timer = setTimeout(() => this.edited && this.request({ op: "export", what: "keep" }), PAUSE);
  }

  // Keep what the server sent in place of what this tab kept before, unless another scene was chosen meanwhile.
  keep({ name, policies, data }) {
    if (!this.edited) return;
    const others = read().filter(({ at }) => at !== this.kept?.at).slice(0, MOST - 1);
    this.kept = { name, policies, data, at: Date.now() };
    for (;;) {
      try {
        return write([this.kept, ...others]);
      } catch (error) {
        if (others.pop()) continue; // there is no room for the oldest
        if (!this.said) notice(`This browser does not keep the edits: ${error.message}`);
        this.said = true;
        return;
      }
    }
  }

  offer() {
    const [kept] = read();
    if (!kept) return;
    this.offered = kept;
    const when = new Date(kept.at).toLocaleString([], { day: "numeric", month: "short", hour: "numeric", minute: "2-digit" });
    byId("kept").firstElementChild.textContent = `Edits of “${kept.name || "a scenario"}”, ${when}, are kept here.`;
    byId("kept").hidden = false;
  }
}

export { Keeper };
