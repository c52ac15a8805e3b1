"use strict";

// Images: a click drops or restores one, and the bar shows the command that calibrates without the dropped ones.
const bar = document.getElementById("dropped");
const command = document.getElementById("dropped-command");
const cards = [...document.querySelectorAll(".card[data-drop]")];

function updateBar() {
  const dropped = cards.filter((card) => card.classList.contains("dropped"));
  bar.hidden = dropped.length === 0;
  document.getElementById("dropped-count").textContent =
    `${dropped.length} image${dropped.length === 1 ? "" : "s"} dropped, ${cards.length - dropped.length} left.`;
  const options = dropped.map((card) => {
    const option = document.createElement("span");
    option.textContent = card.dataset.drop;
    return option;
  });
  command.replaceChildren(bar.dataset.command, ...options.flatMap((option) => [" ", option]));
  document.documentElement.style.scrollPaddingTop = `${bar.offsetHeight + 16}px`;
}

function setDropped(card, isDropped) {
  card.classList.toggle("dropped", isDropped);
  card.querySelector(".drop").setAttribute("aria-pressed", String(isDropped));
  for (const part of document.querySelectorAll(`svg [data-number="${card.dataset.number}"]`)) {
    part.classList.toggle("dropped", isDropped);
  }
  updateBar();
}

for (const card of cards) {
  card.querySelector(".drop").addEventListener("click", () => setDropped(card, !card.classList.contains("dropped")));
}
document.getElementById("dropped-none").addEventListener("click", () => cards.forEach((card) => setDropped(card, false)));

document.getElementById("dropped-copy").addEventListener("click", async (event) => {
  const button = event.currentTarget;
  try {
    await navigator.clipboard.writeText(command.textContent);
    button.textContent = "Copied";
  } catch {
    getSelection().selectAllChildren(command);
    button.textContent = "Selected: copy with Ctrl+C";
  }
  setTimeout(() => { button.textContent = "Copy command"; }, 2500);
});

// Enlarged image.
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

// Board poses: rotated about the y axis of the camera (yaw), then about the horizontal axis of the drawing (pitch).
const scene = document.querySelector(".scene");
const numbers = (text) => text.split(" ").map(Number);
const centre = numbers(scene.dataset.centre);
const viewBox = scene.viewBox.baseVal;
const start = { yaw: Number(scene.dataset.yaw), pitch: Number(scene.dataset.pitch), scale: Number(scene.dataset.scale) };
let view = { ...start };
const eye = Number(scene.dataset.eye);
const labels = scene.querySelectorAll("text");
const shapes = [...scene.querySelectorAll("[data-corners]")].map((path, k) => {
  const flat = numbers(path.dataset.corners);
  const corners = Array.from({ length: flat.length / 3 }, (_, i) => flat.slice(3 * i, 3 * i + 3));
  return { path, text: labels[k], corners };
});

function project(point) {
  const [x, y, z] = point.map((value, i) => value - centre[i]);
  const { yaw, pitch, scale } = view;
  const horizontal = x * Math.cos(yaw) + z * Math.sin(yaw);
  const forward = z * Math.cos(yaw) - x * Math.sin(yaw);
  const vertical = y * Math.cos(pitch) - forward * Math.sin(pitch);
  const depth = y * Math.sin(pitch) + forward * Math.cos(pitch);
  const factor = scale * eye / (eye + depth);
  return [viewBox.width / 2 + factor * horizontal, viewBox.height / 2 + factor * vertical, depth];
}

function draw() {
  for (const shape of shapes) {
    const points = shape.corners.map(project);
    shape.depth = points.reduce((sum, point) => sum + point[2], 0) / points.length;
    const isBoard = points.length > 2;
    shape.path.setAttribute("d", `M${points.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}${isBoard ? "Z" : ""}`);
    const label = isBoard ? points.reduce(([a, b], [x, y]) => [a + x / points.length, b + y / points.length], [0, 0]) : points[1];
    shape.text.setAttribute("x", label[0].toFixed(1));
    shape.text.setAttribute("y", (label[1] + 4).toFixed(1));
  }
  const boards = shapes.filter((shape) => shape.corners.length > 2).sort((a, b) => b.depth - a.depth);
  for (const { path } of boards) path.parentNode.append(path); // farthest first
}

function rotate(yaw, pitch) {
  view.yaw += yaw;
  view.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, view.pitch + pitch));
  draw();
}

function zoom(factor) {
  view.scale = Math.max(start.scale / 10, Math.min(start.scale * 50, view.scale * factor));
  draw();
}

let pointer = null;
scene.addEventListener("pointerdown", (event) => { pointer = [event.clientX, event.clientY]; scene.setPointerCapture(event.pointerId); });
scene.addEventListener("pointermove", (event) => {
  if (!pointer) return;
  rotate(-(event.clientX - pointer[0]) * 0.008, -(event.clientY - pointer[1]) * 0.008);
  pointer = [event.clientX, event.clientY];
});
for (const end of ["pointerup", "pointercancel"]) scene.addEventListener(end, () => { pointer = null; });
scene.addEventListener("wheel", (event) => {
  if (!event.ctrlKey && document.activeElement !== scene) return; // scroll the page
  event.preventDefault();
  zoom(Math.exp(-event.deltaY * 0.0015));
}, { passive: false });
scene.addEventListener("dblclick", () => { view = { ...start }; draw(); });
scene.addEventListener("keydown", (event) => {
  const keys = {
    ArrowLeft: () => rotate(0.1, 0), ArrowRight: () => rotate(-0.1, 0), ArrowUp: () => rotate(0, 0.1), ArrowDown: () => rotate(0, -0.1),
    "+": () => zoom(1.2), "=": () => zoom(1.2), "-": () => zoom(1 / 1.2), Home: () => { view = { ...start }; draw(); },
  };
  if (event.key in keys) { event.preventDefault(); keys[event.key](); }
});
