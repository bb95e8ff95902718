// SPDX-License-Identifier: Apache-2.0
// Controls of the panels. Each has a visible, accessible name. Double-clicking the name of a slider resets it.

let numbers = 0;

/** The number in a field, or null if it is empty. A number out of range is refused: the page says what is expected. */
function numberIn(field, name, low, high, integer) {
  if (field.value === "" && !field.validity.badInput) return null;
  const value = Number(field.value);
  if (!field.validity.badInput && value >= low && value <= high && (!integer || Number.isInteger(value))) return value;
  const expected = `${name}: ${field.value || "not a number"}: expected ${integer ? "an integer" : "a number"} from ${low} to ${high}`;
  field.dispatchEvent(new CustomEvent("refused", { bubbles: true, detail: expected }));
  return undefined;
}

/** An element with properties and children. */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("aria") || name === "role") element.setAttribute(name.replace("aria", "aria-").toLowerCase().replace("--", "-"), value);
    else element[name] = value;
  }
  element.append(...children);
  return element;
}

/** A titled part of a panel. */
export function section(title, ...children) {
  return make("section", {}, make("h2", { textContent: title }), ...children);
}

/**
 * A slider with a number field.
 *
 * `automatic` returns the value in effect where the parameter is null; null if the parameter has no effect then.
 */
export function slider(name, { title, low, high, step, log = false, reset, automatic = null, digits = 2, change }) {
  const id = `c${numbers++}`;
  const position = (v) => (log ? Math.log(v / low) / Math.log(high / low) : (v - low) / (high - low));
  const value = (p) => {
    const exact = log ? low * (high / low) ** p : low + p * (high - low);
    return Math.min(high, Math.max(low, log ? Number(exact.toPrecision(3)) : Math.round(exact / step) * step));
  };
  const range = make("input", { type: "range", id, min: 0, max: 1, step: "any", title });
  const number = make("input", { type: "number", min: low, max: high, step: log ? "any" : step, ariaLabel: `${name} (number)` });
  const label = make("label", { textContent: name, htmlFor: id, title: `${title}. Double-click to reset` });
  const row = make("div", { className: "row" }, label, range, number);
  const shown = (v) => String(Number(v.toFixed(digits)));
  range.addEventListener("input", () => {
    const now = Number(value(Number(range.value)).toFixed(6));
    number.value = shown(now);
    row.classList.remove("auto");
    change(now);
  });
  number.addEventListener("change", () => {
    const given = numberIn(number, name, low, high, false);
    if (given !== undefined) last = given ?? reset;
    set(last, true);
    if (given !== undefined) change(last);
  });
  label.addEventListener("dblclick", () => { set(reset); change(reset); });
  let last = reset;
  function set(v, typed = false) {
    const unset = v === null;
    last = v;
    row.classList.toggle("auto", unset);
    const effective = unset ? automatic?.() ?? null : v;
    const seen = effective ?? low;
    if (typed || document.activeElement !== number) number.value = unset ? "" : shown(seen);
    number.placeholder = effective === null ? "off" : shown(seen);
    range.value = position(Math.min(high, Math.max(low, seen)));
  }
  row.set = set;
  return row;
}

/** A drop-down list; options are [value, text]. */
export function choice(name, { title, options, change }) {
  const id = `c${numbers++}`;
  const select = make("select", { id, title, className: "wide" });
  const row = make("div", { className: "row" }, make("label", { textContent: name, htmlFor: id }), select);
  row.offer = (list) => {
    select.replaceChildren(...list.map(([value, text]) => make("option", { value: JSON.stringify(value), textContent: text })));
  };
  row.offer(options);
  select.addEventListener("change", () => change(JSON.parse(select.value)));
  row.set = (value) => { select.value = JSON.stringify(value); };
  row.select = select;
  return row;
}

/** An integer field. `automatic` returns the value in effect where the parameter is null. */
export function whole(name, { title, low, high, change, automatic = null, extra = [] }) {
  const id = `c${numbers++}`;
  const number = make("input", { type: "number", id, min: low, max: high, step: 1, title });
  const row = make("div", { className: "row" }, make("label", { textContent: name, htmlFor: id }), make("span", { className: "buttons", style: "margin:0" }, number, ...extra));
  row.lastChild.classList.add("wide");
  number.addEventListener("change", () => {
    const given = numberIn(number, name, low, high, true);
    if (given !== undefined) change(given);
    else row.set(last);
  });
  let last = null;
  row.set = (value) => {
    last = value;
    number.value = value ?? "";
    number.placeholder = value === null ? String(automatic?.() ?? "") : "";
  };
  return row;
}

/** A text field; `field` is the element. */
export function words(name, { title, change }) {
  const id = `c${numbers++}`;
  const field = make("input", { type: "text", id, title, spellcheck: false, className: "wide" });
  const row = make("div", { className: "row" }, make("label", { textContent: name, htmlFor: id }), field);
  field.addEventListener("change", () => change(field.value.trim()));
  row.field = field;
  return row;
}

/** A button. */
export function button(text, title, click, more = {}) {
  const element = make("button", { type: "button", textContent: text, title, ...more });
  element.addEventListener("click", click);
  return element;
}

/** Buttons of which exactly one is pressed: [value, text, title]. */
export function segments(name, list, change) {
  const group = make("span", { className: "segments", role: "group", ariaLabel: name });
  const buttons = list.map(([value, text, title]) => {
    const one = button(text, title, () => { group.set(value); change(value); });
    one.dataset.value = value;
    return one;
  });
  group.append(...buttons);
  group.set = (value) => {
    group.value = value;
    for (const one of buttons) one.setAttribute("aria-pressed", String(one.dataset.value === String(value)));
  };
  return group;
}
