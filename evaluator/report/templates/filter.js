"use strict";
const find = document.getElementById("find");
const verdict = document.getElementById("verdict");
const shown = document.getElementById("shown");
const episodes = [...document.querySelectorAll("details.episode")];
// What the placeholder names: the label with scene and seed, the category, the answer.
const texts = episodes.map((one) =>
  [...one.querySelector("summary").children].slice(1, 4).map((part) => part.textContent).join(" ").toLowerCase());

function filter() {
  const words = find.value.toLowerCase().split(/\s+/);
  let count = 0;
  episodes.forEach((one, i) => {
    const fits = (!verdict.value || one.dataset.verdict === verdict.value || verdict.value in one.dataset)
      && words.every((word) => texts[i].includes(word));
    one.hidden = !fits;
    count += fits;
  });
  shown.textContent = `${count} of ${episodes.length} shown`;
}

function openAll(open) {
  for (const one of episodes) if (!one.hidden) one.open = open;
}

for (const one of document.querySelectorAll(".scripted")) one.hidden = false;
find.addEventListener("input", filter);
verdict.addEventListener("change", filter);
document.getElementById("open").addEventListener("click", () => openAll(true));
document.getElementById("close").addEventListener("click", () => openAll(false));
filter();
