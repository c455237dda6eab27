// What the two live pages share: masks, settings, choosers, keys, files, and the connection to the server.

import { bits, byId, make, save } from "/common.js";

const choices = JSON.parse(byId("choices").textContent);
const numberOf = (text) => (text === "" || !Number.isFinite(Number(text)) ? text : Number(text));
const MOST = 4 * 2 ** 20; // bytes of files to open

for (const link of document.querySelectorAll("nav a")) link.search = location.search; // the token, where the page needs one

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

// The mask of amounts that come in 16 shades, two to a byte.
function shadeMask(record, most) {
  const shades = bits(record.shades);
  return { ...record, mask: mask(record.rows, record.cols, (i) => Math.round((most * ((shades[i >> 1] >> (4 * (i & 1))) & 15)) / 15)) };
}

let late = 0; // timer of the text that working() shows
function busy(text) {
  clearTimeout(late);
  byId("busy").textContent = text;
}

// Say that the server is busy once it has been for half a second: kernels are compiled when they are first called.
function working() {
  clearTimeout(late);
  late = setTimeout(busy, 500, "working … (longer the first time)");
}

function notice(text) {
  byId("notice").hidden = !text;
  byId("notice").firstElementChild.textContent = text;
}

// Settings, {field, input, wrong, number}: a field, the element that shows what is wrong with it, and the number of its latest
// request. The text of a refusal stays until the next request, so that the answer to an earlier request does not remove it.
const settings = [];
const asked = []; // {row, text}, by the number of the request

// Request the value of the setting's input, as `valueOf` reads it, whenever the input changes.
function setting(field, input, wrong, valueOf, request) {
  const row = { field, input, wrong, number: -1 };
  settings.push(row);
  input.addEventListener("change", () => {
    accept(row);
    row.number = asked.push({ row, text: input.value }) - 1;
    request({ op: "set", field, value: valueOf(input.value.trim()), number: row.number });
  });
}

function accept({ input, wrong }) {
  input.removeAttribute("aria-invalid");
  wrong.textContent = "";
}

const refused = ({ input }) => input.getAttribute("aria-invalid") === "true";

// Show these values, except where a value was refused or is being typed.
function showSettings(values) {
  for (const row of settings) {
    const { field, input } = row;
    const value = String(values[field] ?? "inf");
    const typing = input === document.activeElement && ![value, input.dataset.shown].includes(input.value);
    if (!refused(row) && !typing) input.value = input.dataset.shown = value;
  }
}

// Show a refusal beside the setting that caused it where that is visible, and otherwise over the page.
function refuse({ number, text }) {
  const { row, text: value } = asked[number] ?? {};
  if (row?.number !== number) return notice(text); // no setting caused it, or the setting was changed again meanwhile
  const { input, wrong } = row;
  if (input !== document.activeElement) input.value = value; // the answer to another request may have replaced it
  input.setAttribute("aria-invalid", "true");
  wrong.textContent = text;
  if (!input.offsetParent || !wrong.isConnected) notice(text);
}

// Clear what was refused, because a new request is made.
function forget() {
  notice("");
  for (const row of settings.filter(refused)) {
    accept(row);
    row.input.value = row.input.dataset.shown;
  }
}

// Offer `names` in the chooser `id` and select `name`; a name that is none of them, opened from a file, stands first.
function choose(id, names, name) {
  const known = names.includes(name);
  byId(id).replaceChildren(...names.map((one) => make("option", one, { value: one })));
  if (!known) byId(id).prepend(make("option", name || "opened", { value: "", disabled: true }));
  byId(id).value = known ? name : "";
}

// The menu closes after a choice and where the page is pressed elsewhere. Returns what closes it.
function menus() {
  const menu = document.querySelector(".menu");
  const close = () => (menu.open = false);
  menu.addEventListener("click", (event) => event.target.tagName === "BUTTON" && close());
  document.addEventListener("pointerdown", (event) => menu.contains(event.target) || close());
  return close;
}

// Call what `actionOf(key, event, onButton)` returns for a key pressed outside text fields and choosers; on a button, space and
// Enter press the button, and on the slider arrows move it.
function listenToKeys(actionOf) {
  document.addEventListener("keydown", (event) => {
    const { tagName, type } = event.target;
    const own = type === "range" ? event.key.startsWith("Arrow") : tagName === "SELECT" || (tagName === "INPUT" && type !== "checkbox");
    if (event.altKey || own) return;
    const action = actionOf(event.key.toLowerCase(), event, ["BUTTON", "INPUT", "SUMMARY"].includes(tagName) && type !== "range");
    if (!action) return;
    event.preventDefault();
    action();
  });
}

const stemOf = (name) => name.replace(/[^\w-]+/g, "-").slice(0, 60);

// Connect to `path`; `take(message)` is called with each message. Returns request(message), which sends one.
function connect(path, take) {
  working();
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`, ["antway", choices.token]);
  socket.addEventListener("message", (event) => {
    const message = JSON.parse(event.data);
    if (!["frame", "kept"].includes(message.kind)) busy("");
    if (message.kind === "file") save(new Blob([message.base64 === undefined ? message.text : bits(message.base64)], { type: message.type }), message.name);
    take(message);
  });
  socket.addEventListener("close", () => {
    busy("");
    document.body.dataset.lost = "true";
    for (const control of document.querySelectorAll("button, select, input")) control.disabled = control.id !== "theme";
    notice("The connection to antway is gone. Reload this page, or start antway serve again and open the address that it prints.");
  });
  return (message) => {
    if (socket.readyState !== WebSocket.OPEN) return;
    if (message.op !== "seen" && message.what !== "keep") forget();
    socket.send(JSON.stringify(message));
  };
}

// The files as the server takes them, or null if they cannot be read; the page then says why.
async function packedFiles(list) {
  const files = [...list];
  if (!files.length) return null;
  if (files.reduce((sum, file) => sum + file.size, 0) > MOST) return notice("These files are too large: at most 4 MiB together."), null;
  const read = (file) => new Promise((resolve, reject) => {
    const reader = new FileReader();
    reader.onload = () => resolve({ name: file.name, data: reader.result.slice(reader.result.indexOf(",") + 1) });
    reader.onerror = () => reject(reader.error);
    reader.readAsDataURL(file);
  });
  try {
    return await Promise.all(files.map(read));
  } catch (error) {
    return notice(`The file cannot be read: ${error.message}`), null;
  }
}

// Let files be opened by the button, the chooser, or by dropping them on the page's middle.
function takeFiles(open) {
  const main = document.querySelector("main");
  const given = async (list) => {
    busy("opening …");
    const files = await packedFiles(list);
    if (files) open(files);
    else busy("");
  };
  byId("open").addEventListener("click", () => byId("files").click());
  byId("files").addEventListener("change", async (event) => {
    const list = [...event.target.files];
    event.target.value = ""; // so that the same file can be opened again
    if (list.length) await given(list);
  });
  main.addEventListener("dragover", (event) => (event.preventDefault(), main.classList.add("over")));
  main.addEventListener("dragleave", () => main.classList.remove("over"));
  main.addEventListener("drop", (event) => {
    event.preventDefault();
    main.classList.remove("over");
    given(event.dataTransfer.files);
  });
  byId("notice").lastElementChild.addEventListener("click", () => notice(""));
}

export {
  busy, choices, choose, connect, listenToKeys, mask, menus, notice, numberOf, refuse, setting, shadeMask, showSettings, stemOf, takeFiles, working,
};
