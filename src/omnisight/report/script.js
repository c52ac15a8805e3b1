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

// Original or undistorted images.
const undistort = document.getElementById("undistort");
let isUndistorted = false;
undistort?.addEventListener("click", () => {
  isUndistorted = !isUndistorted;
  undistort.setAttribute("aria-pressed", String(isUndistorted));
  undistort.textContent = isUndistorted ? "Show originals" : "Show undistorted";
  document.querySelector(".cards").classList.toggle("show-undistorted", isUndistorted);
  document.getElementById("residual-note").hidden = isUndistorted;
});

// The residual next to the pointer. The paths hold the corners and the magnified residuals.
const residualValue = document.getElementById("residual-value");
const MAX_DISTANCE_PX = 12;
const segments = new WeakMap();

function residualsOf(svg) {
  if (!segments.has(svg)) {
    const text = [...svg.querySelectorAll(".residual")].map((path) => path.getAttribute("d")).join("");
    const number = "(-?[\\d.]+)";
    const pattern = new RegExp(`M${number} ${number}l${number} ${number}`, "g");
    segments.set(svg, [...text.matchAll(pattern)].map((match) => match.slice(1).map(Number)));
  }
  return segments.get(svg);
}

function showResidual(event) {
  const svg = event.target.closest?.(".image[data-scale]");
  residualValue.hidden = true;
  if (!svg) return;
  const toImage = svg.getScreenCTM().inverse();
  const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(toImage);
  const distance = ([u, v]) => Math.hypot(u - at.x, v - at.y);
  const nearest = residualsOf(svg).reduce((a, b) => (a && distance(a) < distance(b) ? a : b), null);
  if (!nearest || distance(nearest) > MAX_DISTANCE_PX * toImage.a) return;
  const [u, v, du, dv] = nearest;
  const [x, y] = [du / svg.dataset.scale, dv / svg.dataset.scale];
  residualValue.textContent =
    `corner (${u.toFixed(1)}, ${v.toFixed(1)}): ${Math.hypot(x, y).toFixed(2)} px (${x.toFixed(2)}, ${y.toFixed(2)})`;
  (svg.closest("dialog") ?? document.body).append(residualValue);
  residualValue.hidden = false;
  residualValue.style.left = `${Math.min(event.clientX + 14, innerWidth - residualValue.offsetWidth - 8)}px`;
  residualValue.style.top = `${event.clientY + 16}px`;
}
document.addEventListener("pointermove", showResidual);

// Enlarged image.
const dialog = document.querySelector("dialog");
for (const button of document.querySelectorAll(".enlarge")) {
  button.addEventListener("click", () => {
    const card = button.parentElement;
    const drawing = (isUndistorted && card.querySelector(".undistorted")) || card.querySelector(".image");
    dialog.firstElementChild.replaceChildren(drawing.cloneNode(true));
    dialog.showModal();
  });
}
dialog.addEventListener("click", (event) => {
  if (event.target === dialog || event.target.tagName === "BUTTON") dialog.close();
});
