"use strict";

const PERIOD_MS = 250;
const image = document.querySelector("img");
const advice = document.getElementById("advice");
const rows = document.querySelector("dl");
const state = document.getElementById("state");
let shown = 0;

function row(name, text) {
  const term = document.createElement("dt");
  const value = document.createElement("dd");
  term.textContent = name;
  value.textContent = text;
  return [term, value];
}

async function update() {
  try {
    const response = await fetch("state.json", { cache: "no-store" });
    const now = await response.json();
    if (now.number > 0 && now.number !== shown) {
      shown = now.number;
      image.src = "image.jpg?" + shown;
      image.alt = now.advice;
      advice.textContent = now.advice;
      rows.replaceChildren(...now.rows.flatMap(([name, text]) => row(name, text)));
    }
    state.textContent = "";
  } catch {
    state.textContent = "The command has ended.";
  }
  setTimeout(update, PERIOD_MS);
}

update();
