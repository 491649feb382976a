"use strict";
function keyOf(cell, numeric) {
  if (!cell.hasAttribute("data-sort")) return null;
  var key = cell.getAttribute("data-sort");
  return numeric ? Number(key) : key;
}
function compareKeys(a, b, numeric) {
  return numeric ? a - b : a.localeCompare(b, "en", { numeric: true });
}
function sortBy(head) {
  var table = head.closest("table"), body = table.tBodies[0];
  var column = head.cellIndex, numeric = head.classList.contains("number");
  var down = head.getAttribute("aria-sort") === "ascending", sign = down ? -1 : 1;
  var rows = Array.from(body.rows).map(function (row, place) {
    return { row: row, key: keyOf(row.cells[column], numeric), place: place };
  });
  rows.sort(function (a, b) {
    if (a.key === null || b.key === null) return (a.key === null) - (b.key === null) || a.place - b.place;
    return sign * compareKeys(a.key, b.key, numeric) || a.place - b.place;
  });
  Array.from(table.tHead.rows[0].cells).forEach(function (cell) { cell.removeAttribute("aria-sort"); });
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  rows.forEach(function (entry) { body.appendChild(entry.row); });
}
document.querySelectorAll("table.sortable thead th").forEach(function (head) {
  head.querySelector("button").addEventListener("click", function () { sortBy(head); });
});
document.querySelectorAll("input[data-filter]").forEach(function (box) {
  var table = document.getElementById(box.getAttribute("data-filter"));
  box.addEventListener("input", function () {
    var words = box.value.toLowerCase();
    Array.from(table.tBodies[0].rows).forEach(function (row) {
      row.hidden = words !== "" && row.textContent.toLowerCase().indexOf(words) < 0;
    });
  });
});
