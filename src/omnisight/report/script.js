"use strict";

// Pictures: a click drops one or takes it back, and the bar says the command that does the same.
const bar = document.getElementById("dropped");
const command = document.getElementById("dropped-command");
const cards = [...document.querySelectorAll(".card[data-drop]")];

function show() {
  const dropped = cards.filter((card) => card.classList.contains("dropped"));
  bar.hidden = dropped.length === 0;
  const left = cards.length - dropped.length;
  document.getElementById("dropped-count").textContent =
    `${dropped.length} picture${dropped.length === 1 ? "" : "s"} dropped, ${left} left.`;
  const options = dropped.map((card) => {
    const option = document.createElement("span");
    option.textContent = card.dataset.drop;
    return option;
  });
  command.replaceChildren(bar.dataset.command, ...options.flatMap((option) => [" ", option]));
  document.documentElement.style.scrollPaddingTop = `${bar.offsetHeight + 16}px`;
}

function drop(card, out) {
  card.classList.toggle("dropped", out);
  card.querySelector(".drop").setAttribute("aria-pressed", String(out));
  for (const part of document.querySelectorAll(`svg [data-number="${card.dataset.number}"]`)) {
    part.classList.toggle("dropped", out);
  }
  show();
}

for (const card of cards) {
  card.querySelector(".drop").addEventListener("click", () => drop(card, !card.classList.contains("dropped")));
}
document.getElementById("dropped-none").addEventListener("click", () => cards.forEach((card) => drop(card, false)));

document.getElementById("dropped-copy").addEventListener("click", async (event) => {
  const button = event.currentTarget;
  try {
    await navigator.clipboard.writeText(command.textContent);
    button.textContent = "Copied";
  } catch {
    getSelection().selectAllChildren(command);
    button.textContent = "Selected: copy it with Ctrl+C";
  }
  setTimeout(() => { button.textContent = "Copy the command"; }, 2500);
});

// A picture, large.
const dialog = document.querySelector("dialog");
for (const button of document.querySelectorAll(".enlarge")) {
  button.addEventListener("click", () => {
    dialog.firstElementChild.replaceChildren(button.parentElement.querySelector(".image").cloneNode(true));
    dialog.showModal();
  });
}
dialog.addEventListener("click", (event) => {
  if (event.target === dialog || event.target.tagName === "BUTTON") dialog.close();
});

// The boards: turned about the camera's y axis (yaw), then tipped (pitch).
const scene = document.querySelector(".scene");
const numbers = (text) => text.split(" ").map(Number);
const middle = numbers(scene.dataset.middle);
const paper = scene.viewBox.baseVal;
const start = { yaw: Number(scene.dataset.yaw), pitch: Number(scene.dataset.pitch), scale: Number(scene.dataset.scale) };
let look = { ...start };
const eye = Number(scene.dataset.eye);
const labels = scene.querySelectorAll("text");
const shapes = [...scene.querySelectorAll("[data-corners]")].map((path, k) => {
  const flat = numbers(path.dataset.corners);
  const corners = Array.from({ length: flat.length / 3 }, (_, i) => flat.slice(3 * i, 3 * i + 3));
  return { path, text: labels[k], corners };
});

function seen(point) {
  const [x, y, z] = point.map((value, i) => value - middle[i]);
  const { yaw, pitch, scale } = look;
  const across = x * Math.cos(yaw) + z * Math.sin(yaw);
  const away = z * Math.cos(yaw) - x * Math.sin(yaw);
  const down = y * Math.cos(pitch) - away * Math.sin(pitch);
  const depth = y * Math.sin(pitch) + away * Math.cos(pitch);
  const size = scale * eye / (eye + depth);
  return [paper.width / 2 + size * across, paper.height / 2 + size * down, depth];
}

function draw() {
  for (const shape of shapes) {
    const places = shape.corners.map(seen);
    shape.depth = places.reduce((sum, place) => sum + place[2], 0) / places.length;
    const closed = places.length > 2;
    shape.path.setAttribute("d", `M${places.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}${closed ? "Z" : ""}`);
    const at = closed ? places.reduce(([a, b], [x, y]) => [a + x / places.length, b + y / places.length], [0, 0]) : places[1];
    shape.text.setAttribute("x", at[0].toFixed(1));
    shape.text.setAttribute("y", (at[1] + 4).toFixed(1));
  }
  const boards = shapes.filter((shape) => shape.corners.length > 2).sort((a, b) => b.depth - a.depth);
  for (const { path } of boards) path.parentNode.append(path); // the farthest first
}

function turn(yaw, pitch) {
  look.yaw += yaw;
  look.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, look.pitch + pitch));
  draw();
}

function nearer(factor) {
  look.scale = Math.max(start.scale / 10, Math.min(start.scale * 50, look.scale * factor));
  draw();
}

let held = null;
scene.addEventListener("pointerdown", (event) => { held = [event.clientX, event.clientY]; scene.setPointerCapture(event.pointerId); });
scene.addEventListener("pointermove", (event) => {
  if (!held) return;
  turn(-(event.clientX - held[0]) * 0.008, -(event.clientY - held[1]) * 0.008);
  held = [event.clientX, event.clientY];
});
for (const end of ["pointerup", "pointercancel"]) scene.addEventListener(end, () => { held = null; });
scene.addEventListener("wheel", (event) => {
  if (!event.ctrlKey && document.activeElement !== scene) return; // the page rolls
  event.preventDefault();
  nearer(Math.exp(-event.deltaY * 0.0015));
}, { passive: false });
scene.addEventListener("dblclick", () => { look = { ...start }; draw(); });
scene.addEventListener("keydown", (event) => {
  const keys = {
    ArrowLeft: () => turn(0.1, 0), ArrowRight: () => turn(-0.1, 0), ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
    "+": () => nearer(1.2), "=": () => nearer(1.2), "-": () => nearer(1 / 1.2), Home: () => { look = { ...start }; draw(); },
  };
  if (event.key in keys) { event.preventDefault(); keys[event.key](); }
});
