// SPDX-License-Identifier: Apache-2.0
// The page: its rooms (tabs), what they share (view, status, keys, commands), and a copy of the server's document state.

import { button, choice, make } from "./controls.js";
import { Photos, addressOf } from "./photos.js";
import { connect, on, send } from "./wire.js";
import { TileRoom } from "./tile.js";
import { PaintRoom } from "./paint.js";
import { ZoomRoom } from "./zoom.js";

const LEAST_PACE = 2000; // ms
const AGAIN = new Set(["sample", "stroke", "tiles"]); // requests that are sent again after the connection was lost
const $ = (id) => document.getElementById(id);

/** Services that all rooms use. */
export const shell = {
  state: null,
  facts: null,
  /** Change values of a room: first here, then on the server and the other pages. */
  set(room, values) {
    Object.assign(shell.state[room], values);
    this.ask(room, { do: "set", values });
  },
  ask(room, message, bytes) {
    const sent = send({ room, gesture, ...message }, bytes);
    if (!sent && !AGAIN.has(message.do)) this.status("The server is not connected: this change is not applied", true);
    return sent;
  },
  status(text, wrong = false) {
    $("status").textContent = text;
    $("status").classList.toggle("wrong", wrong);
  },
  place(text) {
    $("place").textContent = text;
  },
  /** Show progress: a bar, and what is done with the percentage and the time left. Returns the text. */
  progress(done, total, text = "") {
    const busy = done < total;
    $("progress").value = busy ? done / total : 0;
    $("progress").hidden = !busy;
    document.body.dataset.busy = String(busy);
    return $("doing").textContent = busy && text ? `${text}: ${Math.floor((100 * done) / total)} %${timeLeft(done / total)}` : "";
  },
  /** Show the next stage of a room's work at once: a short one may end before it reports progress. */
  stage(room, text) {
    if (room === current && !$("progress").hidden) this.progress($("progress").value, 1, text);
  },
};

let paces = []; // [time in ms, part done] of the work that is in progress

/** The time left by the pace of the last half of the time, from a tenth of the work on, as text. */
function timeLeft(part) {
  const now = performance.now();
  if (!part || part < paces.at(-1)?.[1]) paces = []; // work begins
  if (part !== paces.at(-1)?.[1]) paces.push([now, part]);
  const since = Math.min(now - LEAST_PACE, (now + paces[0][0]) / 2);
  const [time, first] = paces.findLast(([at]) => at <= since) ?? paces[0];
  return part < 0.1 || part <= first ? "" : `, ${Math.ceil((((now - time) / 1000) * (1 - part)) / (part - first))} s left`;
}

export const rooms = {};
let current = null;
let gesture = 0; // of a pointer or a key: what it changes is one step of the history
const wantedRoom = () => location.hash.slice(1).split("/")[0];

function open(name) {
  if (!rooms[name] || current === name) return;
  if (current) rooms[current].hide?.();
  current = name;
  for (const [key, room] of Object.entries(rooms)) {
    room.element.hidden = key !== name;
    $(`tab-${key}`).setAttribute("aria-selected", String(key === name));
  }
  shell.place("");
  if (!$("status").classList.contains("wrong")) shell.status(""); // a hint of the other tab
  rooms[name].show?.();
  if (wantedRoom() !== name) history.replaceState(null, "", `#${name}`);
}

function build() {
  const photo = shell.facts.photo !== null;
  const kinds = photo ? [["tile", "Tile", TileRoom], ["paint", "Paint", PaintRoom], ["zoom", "Zoom", ZoomRoom]] : [["zoom", "Zoom", ZoomRoom]];
  for (const [name, title, Room] of kinds) {
    rooms[name] = new Room(shell);
    rooms[name].element.hidden = true;
    $("stage").append(rooms[name].element);
    const tab = button(title, `${title} (${$("rooms").children.length + 1})`, () => open(name), { id: `tab-${name}` });
    tab.setAttribute("role", "tab");
    $("rooms").append(tab);
  }
  buildLooking();
  $("name").textContent = shell.facts.source;
  document.title = `${shell.facts.source} - oiiotex`;
}

const looking = {};

/** Begin a gesture. What the last one has changed is sent first. */
function beginGesture() {
  rooms[current]?.tell?.();
  gesture++;
}
addEventListener("pointerdown", beginGesture, true);
addEventListener("keydown", (event) => { if (!event.repeat) beginGesture(); }, true);
for (const early of [true, false]) // a field that loses the focus begins another gesture; a slider does not
  addEventListener("change", (event) => { if (event.target.type !== "range") beginGesture(); }, early);

function go(forward) {
  beginGesture();
  send({ do: forward ? "redo" : "undo" });
}

/** Show what undo and redo would do and, after them, the room that they have changed. */
function showHistory({ undo, redo, gone, forward, rooms: changed }) {
  for (const [id, text, name, keys] of [["undo", undo, "Undo", "Ctrl Z"], ["redo", redo, "Redo", "Ctrl Shift Z"]]) {
    $(id).disabled = !text;
    $(id).title = `${name}${text ? `: ${text}` : ""} (${keys})`;
  }
  if (gone === undefined) return;
  const room = { tile: "tile", masks: "tile", painting: "paint", zoom: "zoom" }[changed[0]];
  open(room);
  shell.status(`${forward ? "Redone" : "Undone"}: ${gone}`);
}

function buildLooking() {
  const views = (display) => (shell.facts.views[display] ?? []).map((view) => [view, view]);
  looking.display = choice("Display", {
    title: "Display from the OCIO config", options: Object.keys(shell.facts.views).map((name) => [name, name]),
    change: (display) => {
      const view = shell.facts.views[display].includes(shell.state.view.view) ? shell.state.view.view : shell.facts.views[display][0];
      shell.set("view", { display, view });
      showLooking();
    },
  });
  looking.view = choice("View", { title: "View transform of the display", options: [], change: (view) => shell.set("view", { view }) });
  const exposure = make("input", { type: "number", step: 0.25, min: -20, max: 20, title: "Viewing exposure in stops (+ and -). Does not change the result", ariaLabel: "Exposure" });
  exposure.addEventListener("change", () => shell.set("view", { exposure: Math.min(20, Math.max(-20, Number(exposure.value) || 0)) }));
  looking.exposure = exposure;
  looking.views = views;
  for (const one of [looking.display, looking.view]) {
    one.select.setAttribute("aria-label", one.firstChild.textContent);
    $("looking").append(one.select);
  }
  $("looking").append(make("span", { textContent: "Exposure" }), exposure);
  showLooking();
}

function showLooking() {
  const { display, view, exposure } = shell.state.view;
  looking.display.set(display);
  looking.view.offer(looking.views(display));
  looking.view.set(view);
  looking.exposure.value = exposure;
}

/** Show why something is not saved; "": everything is saved. */
function showUnsaved(text) {
  if (!text && !$("unsaved").hidden) shell.status("Saved again");
  $("unsaved").textContent = text;
  $("unsaved").hidden = !text;
}

const KEYS = [
  ["1 2 3", "Switch tabs"], ["F  0", "Fit the image, 1:1"], ["Wheel", "Zoom"], ["Middle drag, Space drag", "Pan"],
  ["Arrows  Page Up, Page Down", "Pan and zoom the view in focus"],
  ["C", "Copy command"], ["+ -", "Viewing exposure, 1/4 stop"], ["?", "This list"],
  ["S", "Tile: next seed"], ["V", "Tile: keep variant"], ["T", "Tile: 1 × 1, 2 × 2, plane"],
  ["M", "Tile: dominant texture"], ["D  R", "Tile: false color of drift, of repetition"],
  ["W  L", "Tile: wipe, link the views"], ["A  B", "Tile: show A, B, or the tile again"], ["Shift A  Shift B", "Tile: store the tile as A, as B"], ["P  E", "Brush, eraser"], ["[  ]", "Brush size"], ["Ctrl Z  Ctrl Shift Z", "Undo, redo"],
  ["G  I", "Paint: fill, pick label"], ["K", "Zoom: add keyframe"], ["P", "Zoom: copy path command"],
];

function help() {
  $("keys").replaceChildren(...KEYS.map(([key, text]) => make("div", {}, make("span", { textContent: text }), make("kbd", { textContent: key }))));
  $("help-dialog").showModal();
}

function copyLine() {
  rooms[current].askLine();
}

/** Copy a command. Only a browser that refuses the clipboard opens a dialog to copy from. */
async function takeLine(text) {
  try {
    await navigator.clipboard.writeText(text);
    shell.status("Command copied to the clipboard");
  } catch {
    $("line").value = text;
    $("line-dialog").showModal();
    $("line").select();
    shell.status("The clipboard is not available. Copy the command from the dialog");
  }
}

addEventListener("keydown", (event) => {
  if (document.querySelector("dialog[open]") || !shell.state) return;
  const typing = event.target.matches("input[type=number], input[type=text], textarea, select");
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !event.target.matches("input[type=text], textarea")) {
    event.preventDefault();
    event.target.blur?.(); // what is typed there is a step
    return go(event.shiftKey);
  }
  if (event.key === "?") return help();
  if (typing && !event.ctrlKey) return;
  if (["1", "2", "3"].includes(event.key)) return open(Object.keys(rooms)[Number(event.key) - 1]);
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if ((key === "+" || key === "=" || key === "-") && !event.ctrlKey) {
    const exposure = Math.min(20, Math.max(-20, shell.state.view.exposure + (key === "-" ? -0.25 : 0.25)));
    shell.set("view", { exposure });
    return showLooking();
  }
  if (key === "c" && !event.ctrlKey && !event.metaKey) return copyLine();
  if (rooms[current]?.key?.(key, event)) event.preventDefault();
});
addEventListener("hashchange", () => {
  open(wantedRoom());
  rooms[current]?.follow?.();
});
addEventListener("keyup", (event) => rooms[current]?.keyUp?.(event.key.toLowerCase()));

const photos = new Photos(shell);

on("message", (message) => {
  if (photos.hear(message)) return;
  if (message.do === "hello") {
    const first = shell.state === null;
    if (message.state === null ? !first : !first && message.document !== shell.facts.document) return location.replace(addressOf(message.key)); // of another server
    photos.greet(message);
    $("copy").disabled = message.state === null;
    if (message.state === null) {
      shell.status("");
      return photos.tellLeft();
    }
    shell.state = message.state;
    shell.facts = message;
    if (first) build();
    for (const room of Object.values(rooms)) room.refresh(true);
    if (first) open(rooms[wantedRoom()] ? wantedRoom() : Object.keys(rooms)[0]);
    showLooking();
    showUnsaved(message.unsaved);
    showHistory(message.history);
    shell.status("");
    photos.tellLeft();
  } else if (message.do === "set") {
    Object.assign(shell.state[message.room], message.values);
    if (message.room === "view") showLooking();
    for (const room of Object.values(rooms)) room.refresh(false);
  } else if (message.do === "busy") {
    rooms[message.room]?.busy?.(message);
    if (message.room && message.room !== current) return;
    const text = shell.progress(message.done, message.total, message.text ?? rooms[message.room].doing);
    if (message.text) rooms.paint?.waitFor(text);
  } else if (message.do === "history") {
    showHistory(message);
  } else if (message.do === "unsaved") {
    showUnsaved(message.text);
  } else if (message.do === "note") {
    shell.status(message.text);
  } else if (message.do === "saved") {
    shell.status(`Saved as ${message.name}`);
    rooms[message.room]?.output.offer(message.name);
  } else if (message.do === "error") {
    shell.status(message.text, true);
    rooms[current]?.fail?.(message.text);
  } else if (message.do === "line") {
    if (message.asked === false) rooms[message.room]?.output?.show(message.text);
    else if (message.room === current) takeLine(message.text);
  } else {
    rooms[message.room]?.hear?.(message);
  }
});
on("frame", (facts, bytes) => (facts.room === "photos" ? photos : rooms[facts.room])?.frame(facts, bytes));
on("link", (there) => {
  $("link").textContent = there ? "" : "Connection to the server lost. Reconnecting ...";
  $("link").classList.toggle("wrong", !there);
});

addEventListener("refused", (event) => shell.status(event.detail, true));
addEventListener("pagehide", () => rooms[current]?.hide?.());
$("undo").addEventListener("click", () => go(false));
$("redo").addEventListener("click", () => go(true));
$("copy").addEventListener("click", copyLine);
$("help").addEventListener("click", help);
connect();
