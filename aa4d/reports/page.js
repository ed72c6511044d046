"use strict";

// Tables: a click on a heading sorts by its column, a second one turns it around; blanks stay last.
const other = { ascending: "descending", descending: "ascending" };

function sortBy(heading) {
  const order = other[heading.getAttribute("aria-sort")] ?? heading.dataset.first;
  const body = heading.closest("table").tBodies[0], sign = order === "ascending" ? 1 : -1;
  const rows = [...body.rows].map((row) => {
    const cell = row.cells[heading.cellIndex];
    const text = cell.textContent.trim();
    return { row, text, number: cell.dataset.value === undefined ? null : Number(cell.dataset.value) };
  });
  const blank = (entry) => entry.number === null && entry.text === "";
  rows.sort((a, b) => {
    if (blank(a) || blank(b)) return blank(a) - blank(b);
    if (a.number !== null && b.number !== null) return sign * (a.number < b.number ? -1 : a.number > b.number ? 1 : 0);
    if (a.number !== null || b.number !== null) return a.number === null ? 1 : -1;
    return sign * a.text.localeCompare(b.text, undefined, { numeric: true });
  });
  body.append(...rows.map((entry) => entry.row));
  for (const one of heading.parentElement.cells) one.setAttribute("aria-sort", one === heading ? order : "none");
}

for (const button of document.querySelectorAll("th button")) {
  button.addEventListener("click", () => sortBy(button.parentElement));
}

// Sliders: the divider follows an invisible range input, which has the keyboard and the pointer of every browser.
for (const slider of document.querySelectorAll(".slider")) {
  const stage = slider.querySelector(".stage"), range = stage.querySelector("input");
  const choice = (name) => slider.querySelector(`select[name=${name}]`);
  const move = () => stage.style.setProperty("--at", `${range.value / 10}%`);
  const show = () => {
    const [view, left, right] = ["view", "left", "right"].map((name) => Number(choice(name).value));
    for (const drawn of stage.querySelectorAll(".drawn")) {
      const here = Number(drawn.dataset.view) === view, which = Number(drawn.dataset.which);
      drawn.classList.toggle("left", here && which === left);
      drawn.classList.toggle("right", here && which === right && left !== right);
    }
    for (const side of ["left", "right"]) {
      const select = choice(side);
      stage.querySelector(`.tag.${side}`).textContent = select.options[select.selectedIndex].textContent;
    }
    const notes = slider.querySelectorAll("[data-note]");
    for (const note of notes) note.hidden = Number(note.dataset.note) !== view;
  };
  range.addEventListener("input", move);
  for (const select of slider.querySelectorAll("select")) select.addEventListener("change", show);
  move();
  show();
}

// Loops: a button holds them still; who asked the system for less motion finds them still.
for (const loop of document.querySelectorAll(".loop")) {
  const button = loop.querySelector("button"), moving = loop.querySelector(".moving"), still = loop.querySelector(".still");
  const play = (on) => {
    moving.hidden = !on;
    still.hidden = on;
    button.textContent = on ? "Hold still" : "Play";
  };
  button.addEventListener("click", () => play(moving.hidden));
  button.hidden = false;
  play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
}
