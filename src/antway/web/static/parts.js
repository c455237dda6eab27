// Small things that the pages share: elements, numbers as text, packed data, files, and the line to the server.

const byId = (id) => document.getElementById(id);
const choices = JSON.parse(byId("choices").textContent);
const make = (tag, text, properties = {}) => Object.assign(document.createElement(tag), { textContent: text, ...properties });
const fixed = (value, digits, unit) => (value == null || !Number.isFinite(value) ? "–" : `${value.toFixed(digits)} ${unit}`.trim());
const MOST = 4 * 2 ** 20; // bytes of files to open

for (const link of document.querySelectorAll("nav a")) link.search = location.search; // the token, where the page needs one

const bits = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

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

// The mask of amounts in 16 shades, two to a byte.
function heat(record, most) {
  const shades = bits(record.shades);
  return { ...record, mask: mask(record.rows, record.cols, (i) => Math.round((most * ((shades[i >> 1] >> (4 * (i & 1))) & 15)) / 15)) };
}

function busy(text) {
  byId("busy").textContent = text;
}

function notice(text) {
  byId("notice").hidden = !text;
  byId("notice").firstElementChild.textContent = text;
}

function save(blob, name) {
  const link = make("a", "", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const stemOf = (name) => name.replace(/[^\w-]+/g, "-").slice(0, 60);

// Connect to `path`; `take(message)` gets each message. Returns wish(message).
function connect(path, take) {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`, ["antway", choices.token]);
  socket.addEventListener("message", (event) => {
    const message = JSON.parse(event.data);
    if (message.kind !== "frame") busy("");
    if (message.kind === "file") save(new Blob([message.base64 === undefined ? message.text : bits(message.base64)], { type: message.type }), message.name);
    take(message);
  });
  socket.addEventListener("close", () => {
    document.body.dataset.lost = "true";
    for (const control of document.querySelectorAll("button, select, input")) control.disabled = control.id !== "theme";
    notice("The connection to antway is gone. Start antway serve again and reload this page.");
  });
  return (message) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  };
}

// The files as the server takes them, or null where they cannot be had; the page then says why.
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

export { bits, busy, byId, choices, connect, fixed, heat, make, mask, notice, save, stemOf, takeFiles };
