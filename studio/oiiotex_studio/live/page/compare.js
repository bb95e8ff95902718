// SPDX-License-Identifier: Apache-2.0
// Comparing: linked views, a wipe, and two stored tiles, A and B, to flip between.

import { button, make, segments } from "./controls.js";
import { Viewer } from "./viewer.js";

const STEP = 0.02; // of the view, of an arrow key
const USUAL = { lattice: 0.5, seed: 0, measure: "histogram", mask: "", fill: "" }; // other parameters: null

export class Compare {
  constructor(room) {
    this.room = room;
    this.stored = { A: null, B: null }; // {canvas, size, tile (parameters), whole}
    this.showing = "";
    this.wipe = null; // fraction of the view's width; null: off
    const { photoView, tileView } = room;
    this.divider = make("div", { className: "divider", role: "slider", tabIndex: 0, hidden: true, ariaLabel: "Wipe", ariaValuemin: 0, ariaValuemax: 100, title: "Drag, or use the left and right arrows" });
    tileView.element.append(this.divider);
    this.divider.addEventListener("pointerdown", (event) => { this.divider.setPointerCapture(event.pointerId); event.preventDefault(); this.divider.focus(); });
    this.divider.addEventListener("pointermove", (event) => {
      if (!this.divider.hasPointerCapture(event.pointerId)) return;
      const box = tileView.element.getBoundingClientRect();
      this.setWipe((event.clientX - box.left) / box.width);
    });
    this.divider.addEventListener("keydown", (event) => {
      const to = { ArrowLeft: this.wipe - STEP, ArrowRight: this.wipe + STEP, Home: 0, End: 1 }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      this.setWipe(to);
    });
    this.linkButton = button("Link", "Pan and zoom the photo and the tile together (L)", () => this.setLinked(!photoView.linked), { ariaPressed: "false" });
    this.wipeButton = button("Wipe", "Photo left of the divider, tile right of it (W). While A or B is shown, the other one is on the left", () => this.setWipe(this.wipe === null ? 0.5 : null), { ariaPressed: "false" });
    this.picker = segments("Shown", [["", "Tile", "The current tile"], ["A", "A", "The tile stored as A (A)"], ["B", "B", "The tile stored as B (B)"]], (name) => this.show(name));
    this.picker.set("");
    this.use = button("Use", "Set the parameters to those of the tile that is shown", () => room.set({ ...this.stored[this.showing].tile }), { disabled: true });
    this.text = make("span", { className: "fact", ariaLive: "polite", hidden: true });
    tileView.element.append(this.bar = make("div", { className: "bar low" }, this.text,
      button("Fit", "Fit the images into the views (F)", () => this.fit()), button("1:1", "One pixel of the file for one pixel of the screen (0)", () => this.oneToOne()), this.linkButton, this.wipeButton,
      this.picker, button("Set A", "Store the tile as A (Shift A)", () => this.store("A")), button("Set B", "Store the tile as B (Shift B)", () => this.store("B")), this.use));
  }

  fit() {
    if (!this.room.photoView.linked) this.room.photoView.fit();
    this.room.tileView.fit();
  }

  oneToOne() {
    if (!this.room.photoView.linked) this.room.photoView.oneToOne();
    this.room.tileView.oneToOne();
  }

  setLinked(linked) {
    Viewer.link(this.room.tileView, this.room.photoView, linked);
    this.linkButton.setAttribute("aria-pressed", String(linked));
  }

  setWipe(wipe) {
    this.wipe = wipe === null ? null : Math.min(1, Math.max(0, wipe));
    this.wipeButton.setAttribute("aria-pressed", String(wipe !== null));
    this.divider.hidden = wipe === null || !["1x1", "2x2"].includes(this.room.mode);
    if (wipe !== null) {
      const left = this.showing && this.other() ? (this.showing === "A" ? "B" : "A") : "Photo";
      Object.assign(this.divider.dataset, { left, right: this.showing || "Tile" });
      this.divider.style.left = `${100 * this.wipe}%`;
      this.divider.setAttribute("aria-valuenow", String(Math.round(100 * this.wipe)));
    }
    this.room.tileView.redraw();
  }

  // --- A and B ---

  /** Store the current tile. A coarse one is replaced when it is finished. */
  store(name) {
    const { room } = this;
    if (!room.tile) return room.shell.status(`Wait for the first preview, then store ${name}`);
    this.stored[name] = { canvas: room.tile, size: room.size, whole: room.whole, tile: { ...room.shell.state.tile } };
    room.shell.status(`Stored as ${name}. Press ${name} to see it`);
    this.describe();
    this.setWipe(this.wipe);
  }

  /** A new picture of the current tile: stored ones with its parameters are replaced. */
  taken() {
    const { room } = this;
    const now = JSON.stringify(room.shell.state.tile);
    for (const one of Object.values(this.stored)) {
      if (one && !one.whole && room.whole && JSON.stringify(one.tile) === now) Object.assign(one, { canvas: room.tile, size: room.size, whole: true });
    }
  }

  /** Show A, B, or the current tile (""). */
  show(name) {
    if (name && !this.stored[name]) {
      this.room.shell.status(`${name} is empty: store a tile with Set ${name} (Shift ${name})`);
      name = "";
    }
    this.showing = name;
    this.picker.set(name);
    this.use.disabled = !name;
    this.describe();
    this.setWipe(this.wipe);
    this.room.picked();
  }

  /** The parameters in which A and B differ; of a single one, those that are set. */
  describe() {
    const { A, B } = this.stored;
    const said = (one, other) => Object.entries(one.tile).filter(([name, value]) => value !== (other ? other.tile[name] : USUAL[name] ?? null))
      .map(([name, value]) => `${name} ${value === null ? "automatic" : value === "" ? "none" : value}`).join(", ") || (other ? "the same parameters" : "automatic");
    this.text.hidden = !A && !B;
    this.text.textContent = [A && `A: ${said(A, B)}.`, B && `B: ${said(B, A)}.`].filter(Boolean).join(" ");
  }

  /** Show a thumbnail while the pointer or the focus is on it; null: no more. */
  peek(canvas) {
    if (this.peeked === canvas) return;
    this.peeked = canvas;
    this.room.picked();
  }

  /** The tile that the view shows, before the first one the coarse tile of its preset: {canvas, size}. */
  shown() {
    const { tile, size, shell, strip } = this.room;
    const peeked = this.peeked ?? (tile ? null : strip.presets.get(strip.chosenPreset()));
    if (peeked) return { canvas: peeked, size: tile ? size : shell.facts.photo };
    return this.stored[this.showing] ?? { canvas: tile, size };
  }

  /** The stored tile that the one shown is compared with, if there is one. */
  other() {
    return this.showing ? this.stored[this.showing === "A" ? "B" : "A"] : null;
  }

  // --- drawing ---

  /** Draw the tile, repeated `times`, and left of the divider what it is compared with. */
  draw(context, viewer, times) {
    const { room } = this;
    const { inspect } = room;
    const { canvas, size } = this.shown();
    const area = size.map((n) => n * times);
    repeat(context, canvas === room.tile ? inspect.picture("tile", canvas) : canvas, size, area);
    if (this.wipe === null) return;
    const { canvas: before, size: own } = this.other() ?? { canvas: inspect.picture("photo", room.photo), size: room.shell.facts.photo };
    if (!before) return;
    const { clientWidth, clientHeight } = viewer.element;
    const place = context.getTransform();
    const ratio = viewer.canvas.width / Math.max(1, clientWidth);
    context.save();
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.beginPath();
    context.rect(0, 0, this.wipe * clientWidth, clientHeight);
    context.clip();
    context.fillRect(0, 0, clientWidth, clientHeight);
    context.setTransform(place);
    repeat(context, before, own, area);
    context.restore();
  }
}

/** Repeat an image of a size over an area from its upper left corner. */
function repeat(context, canvas, [width, height], [wide, high]) {
  context.save();
  context.beginPath();
  context.rect(0, 0, wide, high);
  context.clip();
  for (let y = 0; y < high; y += height) for (let x = 0; x < wide; x += width) context.drawImage(canvas, x, y, width, height);
  context.restore();
}
