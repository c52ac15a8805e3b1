// A scene in 3-D: rotated about the y axis of the camera (yaw), then about the horizontal axis of the drawing (pitch).
// Shapes with two points, and those marked as open, are lines; others are closed and sorted by their distance.
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
  return { path, text: labels[k], corners, isClosed: corners.length > 2 && !("open" in path.dataset) };
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
    shape.path.setAttribute("d", `M${points.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}${shape.isClosed ? "Z" : ""}`);
    const label = shape.isClosed ? points.reduce(([a, b], [x, y]) => [a + x / points.length, b + y / points.length], [0, 0]) : points[points.length - 1];
    shape.text.setAttribute("x", label[0].toFixed(1));
    shape.text.setAttribute("y", (label[1] + 4).toFixed(1));
  }
  const faces = shapes.filter((shape) => shape.isClosed).sort((a, b) => b.depth - a.depth);
  for (const { path } of faces) path.parentNode.append(path); // farthest first
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
