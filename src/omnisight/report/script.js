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
