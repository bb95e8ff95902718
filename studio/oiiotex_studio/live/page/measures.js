// SPDX-License-Identifier: Apache-2.0
// Measures of a finished tile: sentences with a grade, and the figures in a fold-out list.

import { make } from "./controls.js";

const MARKS = { good: "●", fair: "▲", poor: "■" };

/** Elements for the lines of -v, [level, text]: verdicts and warnings first, then figures and other lines. */
export function measuresOf(lines) {
  const shown = lines.filter(([level]) => level !== "debug");
  const verdicts = [], rows = [], others = [];
  for (const [level, text] of shown) {
    const [, grade, sentence] = /^(good|fair|poor): (.*)$/.exec(text) ?? [];
    const row = figure(text);
    if (grade) verdicts.push(make("p", { className: grade }, make("span", { className: "mark", textContent: MARKS[grade], role: "img", ariaLabel: grade }), sentence));
    else if (level === "warning") verdicts.push(make("p", { className: "fair" }, make("span", { className: "mark", textContent: MARKS.fair, role: "img", ariaLabel: "warning" }), text[0].toUpperCase() + text.slice(1)));
    else if (row) rows.push(row);
    else others.push(make("p", { textContent: text }));
  }
  const cells = (tag, words) => words.map((text) => make(tag, { textContent: text }));
  const table = make("table", {}, make("tr", {}, ...cells("th", ["Measure", "Photo", "Tile"])),
    ...rows.map(({ name, photo, tile, title }) => make("tr", { title }, ...cells("td", [name, photo, tile]))));
  return [...verdicts, make("details", {}, make("summary", { textContent: "Figures" }), table, ...others)];
}

/** "NAME PHOTO -> TILE UNIT (description)" or "NAME TILE UNIT (description)" as a row; else null. */
function figure(text) {
  const found = /^([a-z][a-z -]*?) (-?[\d.]+)(?: -> (-?[\d.]+))?( %)?.*\(/.exec(text);
  if (!found) return null;
  const [, name, first, second, unit = ""] = found;
  return { name, photo: second === undefined ? "" : first + unit, tile: (second ?? first) + unit, title: text };
}
