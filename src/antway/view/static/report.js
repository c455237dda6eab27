// A thumbnail opens the replay of its episode in a new tab: the shared page with this episode's data put in.
const shell = JSON.parse(document.getElementById("shell").textContent);
const replays = JSON.parse(document.getElementById("replays").textContent);
const slot = '<script type="application/json" id="episode">';

for (const button of document.querySelectorAll("[data-replay]")) {
  button.addEventListener("click", () => {
    const at = shell.indexOf(slot) + slot.length;
    const page = shell.slice(0, at) + replays[Number(button.dataset.replay)] + shell.slice(at);
    window.open(URL.createObjectURL(new Blob([page], { type: "text/html" })));
  });
}
