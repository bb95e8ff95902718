// SPDX-License-Identifier: Apache-2.0
// Room Tile: the photo next to its tile.

import { button, choice, make, section, segments, slider, whole } from "./controls.js";
import { measuresOf } from "./measures.js";
import { Output } from "./output.js";
import { drawPlane, mipmaps } from "./plane.js";
import { Strip } from "./strip.js";
import { Viewer, drawBrush, stroke } from "./viewer.js";
import { canvasOf } from "./wire.js";

const LET_GO = 60; // ms from the last change of a slider to the message to the server
const PATCHES = [5, 7, 9, 11, 13, 15, 17, 19, 21]; // px

export class TileRoom {
  constructor(shell) {
    this.shell = shell;
    this.photo = this.tile = null;
    this.size = [0, 0]; // of the full-size tile, px; previews are smaller
    this.mode = "2x2";
    this.brush = { name: "", tool: "brush", diameter: 48 };
    this.planes = { mask: null, inpaint: null }; // Uint8, at the photo's preview size
    this.shownOver = "";
    this.overlay = null;
    this.waiting = {};
    this.build();
  }

  // --- elements ---

  build() {
    this.photoView = new Viewer("Photo", {
      size: () => (this.photo ? [this.photo.width, this.photo.height] : [0, 0]),
      draw: (context) => this.drawPhoto(context),
      overlay: (context, viewer) => drawBrush(context, viewer, this.brush.diameter),
      paint: {
        active: () => this.brush.name !== "" && this.photo !== null,
        down: (x, y, event) => this.strokeFrom(x, y, event),
        move: (x, y, event) => this.strokeTo(x, y, event),
        up: () => this.strokeEnds(),
      },
    });
    this.tileView = new Viewer("Tile", {
      size: () => (!this.tile ? [0, 0] : this.mode === "1x1" ? this.size : [2 * this.size[0], 2 * this.size[1]]),
      draw: (context) => this.drawTile(context),
    });
    this.photoView.canvas.addEventListener("click", (event) => this.pickLabel(event));
    this.planeCanvas = make("canvas", { role: "img", ariaLabel: "Tile on a plane", hidden: true });
    this.tileView.element.append(this.planeCanvas);
    new ResizeObserver(() => this.drawPlane()).observe(this.tileView.element);
    this.modes = segments("Layout", [["1x1", "1 × 1", "One tile (T)"], ["2x2", "2 × 2", "Two by two tiles (T)"], ["plane", "Plane", "Perspective plane, to judge repetition (T)"]], (mode) => this.setMode(mode));
    this.fact = make("span", { className: "fact" });
    this.tileView.bar.append(this.modes, make("span", { className: "grow" }), this.fact);
    this.overlays = segments("Overlay", [["", "Photo", "Photo without overlay"], ["dominant", "Dominant", "Overlay of the dominant texture (LDR09) (M)"], ["label", "Labels", "Overlay of the coarsest label map (LSA16)"]], (name) => this.showOver(name));
    this.overlays.set("");
    this.photoView.bar.append(this.overlays);
    this.tileView.empty.textContent = "Synthesizing the tile ...";
    this.tileView.empty.hidden = false;
    this.strip = new Strip(this);
    this.element = make("div", { className: "room" },
      make("div", { className: "work" }, make("div", { className: "views" }, this.photoView.element, this.tileView.element), this.strip.element),
      this.panel());
    this.modes.set(this.mode);
    this.strip.show();
  }

  panel() {
    const set = (values) => this.set(values);
    const effective = (name) => this.chosen?.[name] ?? this.planned()[name];
    this.controls = {
      flatten: slider("Flatten", { title: "Fraction of the photo's gradients and stains to remove before synthesis. 0 copies the photo's pixels unchanged", low: 0, high: 1, step: 0.05, reset: null, automatic: () => 1, change: (flatten) => set({ flatten }) }),
      sigma: slider("Sigma", { title: "Scale, in pixels, above which the result is statistically uniform (MJH17)", low: 1, high: 512, log: true, reset: null, automatic: () => effective("sigma"), change: (sigma) => set({ sigma, amount: null }) }),
      amount: slider("Amount", { title: "Perceived uniformity, an alternative to sigma: the matching sigma is measured on this photo (MJH17 section 4.4)", low: 0, high: 1, step: 0.05, reset: null, change: (amount) => set({ amount, sigma: null }) }),
      contrast: slider("Contrast", { title: "Weight of matching the photo's overall histogram", low: 0, high: 1, step: 0.05, reset: null, automatic: () => effective("contrast"), change: (contrast) => set({ contrast }) }),
      structure: slider("Structure", { title: "Weight of preserving a regular structure of the photo (courses, weaves)", low: 0, high: 1, step: 0.05, reset: 0.5, change: (structure) => set({ structure }) }),
      seed: whole("Seed", { title: "Random seed. The same seed gives the same pixels", low: 0, high: 4294967295, change: (seed) => set({ seed: seed ?? 0 }), extra: [button("Next", "Next seed (S)", () => this.nextSeed())] }),
      measure: choice("Measure", { title: "Statistics that are made uniform", options: [["histogram", "Histogram"], ["moments", "Moments"], ["steerable", "Steerable"]], change: (measure) => set({ measure }) }),
      preset: choice("Preset", { title: "Keep: large structures are preserved. Even: structures larger than sigma are evened out. Clean: objects are removed", options: [[null, "None"], ["even", "Even"], ["clean", "Clean"], ["keep", "Keep"]], change: (preset) => set({ preset }) }),
      patch: choice("Patch", { title: "Patch size: detail up to this scale is copied unchanged", options: [], change: (patch) => set({ patch }) }),
      width: whole("Width", { title: "Width of the tile, in pixels. Empty: the photo's width", low: 16, high: 16384, automatic: () => this.shell.facts?.photo[0], change: (width) => set({ width }) }),
      height: whole("Height", { title: "Height of the tile, in pixels. Empty: the photo's height", low: 16, high: 16384, automatic: () => this.shell.facts?.photo[1], change: (height) => set({ height }) }),
      mask: choice("Source", { title: "Valid source pixels: the part of the photo that patches are copied from", options: [["", "Whole photo"], ["dominant", "Dominant texture"], ["brush", "Painted mask"]], change: (mask) => this.setMask(mask) }),
      inpaint: choice("Replace", { title: "Painted area: only this part is replaced (--texfill), by patches from Source; patch, structure and seed apply", options: [["", "Everything"], ["brush", "Painted area"]], change: (inpaint) => set({ inpaint }) }),
    };
    this.tools = segments("Brush", [["", "Off", "No brush"], ["mask", "Source", "Paint the valid source pixels (B)"], ["inpaint", "Replace", "Paint the area to replace"]], (name) => this.setBrush(name));
    this.erase = button("Erase", "The brush erases (E)", () => this.setTool(this.brush.tool === "erase" ? "brush" : "erase"));
    this.diameter = slider("Size", { title: "Brush diameter, in pixels of the photo ([ and ])", low: 2, high: 400, log: true, reset: 48, digits: 0, change: (diameter) => { this.brush.diameter = diameter; } });
    this.diameter.set(48);
    this.tools.set("");
    this.measures = make("div", { className: "measures", ariaLive: "polite" }, make("p", { className: "stale", textContent: "Measured when the tile is finished." }));
    this.output = new Output(this.shell, "tile", [button("Save", "Write the tile to the document's folder, in the background", () => { this.tell(); this.shell.ask("tile", { do: "save" }); })]);
    return make("aside", {},
      section("Texture", this.controls.preset, this.controls.flatten, this.controls.sigma, this.controls.amount, this.controls.contrast, this.controls.structure, this.controls.measure, this.controls.patch),
      section("Result", this.controls.seed, this.controls.width, this.controls.height,
        make("div", { className: "buttons" }, button("Keep variant", "Add these parameters to the variants below (V)", () => this.strip.keep()), button("Show seeds", "Preview eight more seeds at low resolution", () => this.strip.askSeeds()))),
      section("Measures", this.measures),
      this.output.element,
      section("Regions", this.controls.mask, this.controls.inpaint, make("div", { className: "row" }, make("span", { className: "label", textContent: "Paint" }), make("span", { className: "wide" }, this.tools)), this.diameter,
        make("div", { className: "buttons" }, this.erase, button("Clear", "Erase everything painted", () => this.fill(0)), button("Invert", "Invert the painted mask", () => this.fill(null)))));
  }

  /** Values in effect where the photo decides, before its result is known. */
  planned() {
    const { tile } = this.shell.state;
    const { share, ...values } = this.shell.facts.presets[tile.preset ?? ""];
    const [width, height] = this.shell.facts.photo;
    const patch = tile.patch ?? values.patch;
    return { ...values, patch, sigma: Math.max(Math.max(tile.width ?? width, tile.height ?? height) / share, patch / 4) };
  }

  set(values) {
    this.chosen = null;
    Object.assign(this.shell.state.tile, values);
    this.refresh(false);
    Object.assign(this.waiting, values);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.tell(), LET_GO);
  }

  /** Send the changed values to the server. */
  tell() {
    clearTimeout(this.timer);
    const told = this.waiting;
    this.waiting = {};
    if (Object.keys(told).length) this.shell.set("tile", told);
  }

  setMask(mask) {
    if (mask === "dominant") this.showOver("dominant");
    this.set({ mask });
  }

  setMode(mode) {
    this.mode = mode;
    this.modes.set(mode);
    const plane = mode === "plane";
    this.planeCanvas.hidden = !plane;
    this.tileView.canvas.hidden = plane;
    if (plane) this.drawPlane();
    else this.tileView.fit();
  }

  nextSeed() {
    this.set({ seed: (this.shell.state.tile.seed + 1) % 4294967296 });
  }

  /** Set the controls to the state. */
  refresh(all) {
    const tile = this.shell.state?.tile;
    if (!tile) return;
    for (const [name, control] of Object.entries(this.controls)) {
      if (name === "mask" && typeof tile.mask === "number") {
        control.offer([["", "Whole photo"], ["dominant", "Dominant texture"], ["brush", "Painted mask"], [tile.mask, `Label ${tile.mask}`]]);
      }
      control.set(tile[name]);
    }
    const patch = this.chosen?.patch ?? this.planned().patch;
    this.controls.patch.offer([[null, `Automatic (${patch} px)`], ...PATCHES.map((n) => [n, `${n} px`])]);
    this.controls.patch.set(tile.patch);
    this.output.refresh();
    if (all) {
      this.photoView.empty.hidden = true;
      this.strip.show();
    }
    this.strip.showVariants();
  }

  // --- messages from the server ---

  frame(facts, bytes) {
    if (facts.kind === "photo") {
      this.photo = canvasOf(facts, bytes);
      for (const name of ["mask", "inpaint"]) {
        if (this.planes[name]?.length !== facts.width * facts.height) this.planes[name] = null;
      }
      if (this.photoView.fitted) this.photoView.fit();
      this.photoView.redraw();
    } else if (facts.kind === "tile") {
      this.tile = canvasOf(facts, bytes);
      this.levels = null;
      const scale = facts.whole ? 1 : 0;
      this.whole = facts.whole;
      if (scale || !this.size[0]) this.size = facts.size;
      else this.size = this.sizeWhileCoarse(facts.size);
      this.fact.textContent = facts.whole ? `${facts.size[0]} × ${facts.size[1]}` : "coarse";
      this.tileView.empty.hidden = true;
      if (this.tileView.fitted) this.tileView.fit();
      this.tileView.redraw();
      this.drawPlane();
      this.element.dataset.turn = String(facts.turn);
      this.element.dataset.tile = facts.whole ? "whole" : "coarse";
      if (this.strip.keeping) this.strip.keep();
      else if (facts.whole) this.strip.showThumbnail();
    } else if (facts.kind === "seed") {
      this.strip.seeds.set(facts.seed, canvasOf(facts, bytes));
      this.strip.show();
    } else if (facts.kind === "brush") {
      this.planes[facts.name] = new Uint8Array(bytes);
      this.photoView.redraw();
    } else if (facts.kind === "overlay") {
      this.overlay = { ...facts, plane: new Uint8Array(bytes), canvas: null };
      this.overlay.canvas = this.tinted(this.overlay);
      this.photoView.redraw();
      this.shell.status(facts.name === "label" ? "Click a label to use it as the only source" : "");
    }
  }

  /** A preview is drawn at the size of the last finished tile, unless its aspect ratio differs. */
  sizeWhileCoarse(size) {
    const { width, height } = this.shell.state.tile;
    const [wide, high] = this.shell.facts.photo;
    if (width || height) return [width ?? wide, height ?? high];
    const like = Math.abs(size[0] / size[1] - this.size[0] / this.size[1]) < 0.05;
    return like ? this.size : this.shell.facts.photo;
  }

  hear(message) {
    if (message.do !== "measures") return;
    this.measures.replaceChildren(...measuresOf(message.lines));
    this.chosen = Object.fromEntries(message.chosen.split(":").filter(Boolean).map((word) => [word.split("=")[0], Number(word.split("=")[1])]));
    this.refresh(false);
  }

  busy(message) {
    if (message.done === 0) {
      this.chosen = null;
      for (const line of this.measures.querySelectorAll("p, table")) line.className = "stale";
    }
  }

  askLine() {
    this.tell();
    this.shell.ask("tile", { do: "line" });
  }

  // --- drawing ---

  drawPhoto(context) {
    context.drawImage(this.photo, 0, 0);
    const { width, height } = this.photo;
    if (this.overlay && this.shownOver) context.drawImage(this.overlay.canvas, 0, 0, width, height);
    const name = this.brush.name || (this.shell.state.tile.mask === "brush" ? "mask" : this.shell.state.tile.inpaint ? "inpaint" : "");
    const plane = this.planes[name];
    if (plane && !this.shownOver) {
      if (this.tintOf !== plane || this.tintStale) {
        this.tint = this.tinted({ plane, width, height, ids: [255], colors: [name === "mask" ? "90,170,110" : "214,130,60"] });
        this.tintOf = plane;
        this.tintStale = false;
      }
      context.drawImage(this.tint, 0, 0);
    }
  }

  /** A plane of ids as a canvas of semi-transparent colors. */
  tinted({ plane, width, height, ids, colors }) {
    const table = new Uint32Array(256);
    ids.forEach((id, n) => {
      const [red, green, blue] = colors[n].split(",").map(Number);
      table[id] = 0x8c000000 | red | (green << 8) | (blue << 16);
    });
    const canvas = make("canvas", { width, height });
    const image = new ImageData(width, height);
    const out = new Uint32Array(image.data.buffer);
    for (let n = 0; n < out.length; n++) out[n] = table[plane[n]];
    canvas.getContext("2d").putImageData(image, 0, 0);
    return canvas;
  }

  drawTile(context) {
    const [width, height] = this.size;
    const times = this.mode === "1x1" ? 1 : 2;
    for (let y = 0; y < times; y++) for (let x = 0; x < times; x++) context.drawImage(this.tile, x * width, y * height, width, height);
  }

  drawPlane() {
    if (this.mode !== "plane" || !this.tile) return;
    const { clientWidth, clientHeight } = this.tileView.element;
    if (!clientWidth) return;
    this.planeCanvas.width = clientWidth;
    this.planeCanvas.height = clientHeight;
    this.levels ??= mipmaps(this.tile);
    drawPlane(this.planeCanvas, this.levels, (clientWidth / this.size[0]) * 0.8);
  }

  showOver(name) {
    this.shownOver = name;
    this.overlays.set(name);
    if (name && this.overlay?.name !== name) {
      this.shell.status(name === "dominant" ? "Finding the dominant texture ..." : "Finding labels ...");
      this.shell.ask("tile", { do: "overlay", name });
    }
    this.setBrush(this.brush.name);
    this.photoView.redraw();
  }

  /** Use the label under the pointer as the only source. */
  pickLabel(event) {
    if (this.shownOver !== "label" || this.overlay?.name !== "label") return;
    const { plane, width, height } = this.overlay;
    const [x, y] = this.photoView.at(event);
    const [column, row] = [Math.floor((x * width) / this.photo.width), Math.floor((y * height) / this.photo.height)];
    if (column < 0 || row < 0 || column >= width || row >= height) return;
    const label = plane[row * width + column];
    if (label) this.set({ mask: label });
  }

  // --- the brush ---

  setBrush(name) {
    this.brush.name = this.shownOver === "label" ? "" : name;
    this.tools.set(this.brush.name);
    if (this.brush.name && this.shownOver) this.showOver("");
    this.photoView.canvas.style.cursor = this.brush.name ? "none" : "";
    this.photoView.redraw();
  }

  setTool(tool) {
    this.brush.tool = tool;
    this.erase.setAttribute("aria-pressed", String(tool === "erase"));
  }

  plane() {
    const { name } = this.brush;
    this.planes[name] ??= new Uint8Array(this.photo.width * this.photo.height);
    return this.planes[name];
  }

  strokeFrom(x, y, event) {
    this.remember();
    this.last = [x, y];
    this.strokeTo(x, y, event);
  }

  strokeTo(x, y, event) {
    const pressure = event.pointerType === "pen" ? Math.max(0.05, event.pressure) : 1;
    stroke(this.plane(), this.photo.width, this.photo.height, this.last, [x, y], this.brush.diameter * pressure, this.brush.tool === "erase" ? 0 : 255);
    this.last = [x, y];
    this.tintStale = true;
    this.photoView.redraw();
  }

  strokeEnds() {
    this.sendBrush(this.brush.name);
  }

  /** Send a painted plane, and what the parameter of that name becomes: "brush", or its value before the first stroke. */
  sendBrush(name, value = "brush") {
    const other = this.shell.state.tile[name] !== value;
    if (other && value !== "brush") { // first, because nothing can be made of an empty mask
      this.set({ [name]: value });
      this.tell();
    }
    this.shell.ask("tile", { do: "brush", name }, this.planes[name]);
    this.tintStale = true;
    this.photoView.redraw();
    if (other && value === "brush") this.set({ [name]: value });
  }

  fill(value) {
    if (!this.brush.name) return this.shell.status("First choose what to paint: Source or Replace");
    this.remember();
    const plane = this.plane();
    if (value === null) for (let n = 0; n < plane.length; n++) plane[n] = 255 - plane[n];
    else plane.fill(value);
    this.sendBrush(this.brush.name);
  }

  /** Keep the painted plane, and whether it was used, for undo. */
  remember() {
    this.history ??= { mask: { past: [], future: [] }, inpaint: { past: [], future: [] } };
    const history = this.history[this.brush.name];
    history.past.push(this.painted());
    if (history.past.length > 50) history.past.shift();
    history.future = [];
  }

  painted() {
    return { plane: this.plane().slice(), value: this.shell.state.tile[this.brush.name] };
  }

  undo(forward) {
    const { name } = this.brush;
    const [from, to] = forward ? ["future", "past"] : ["past", "future"];
    const steps = this.history?.[name];
    if (!name || !steps?.[from].length) return;
    steps[to].push(this.painted());
    const { plane, value } = steps[from].pop();
    this.planes[name] = plane;
    this.sendBrush(name, value);
  }

  // --- keys ---

  key(key, event) {
    if (key === " ") this.photoView.space = this.tileView.space = true;
    else if (key === "z" && (event.ctrlKey || event.metaKey)) this.undo(event.shiftKey);
    else if (event.ctrlKey || event.metaKey) return false;
    else if (key === "f") { this.photoView.fit(); this.tileView.fit(); }
    else if (key === "s") this.nextSeed();
    else if (key === "v") this.strip.keep();
    else if (key === "t") this.setMode({ "1x1": "2x2", "2x2": "plane", plane: "1x1" }[this.mode]);
    else if (key === "m") this.showOver(this.shownOver === "dominant" ? "" : "dominant");
    else if (key === "b") { this.setTool("brush"); this.setBrush(this.brush.name || "mask"); }
    else if (key === "e") { this.setTool("erase"); this.setBrush(this.brush.name || "mask"); }
    else if (key === "[" || key === "]") {
      this.brush.diameter = Math.min(400, Math.max(2, this.brush.diameter * (key === "[" ? 0.8 : 1.25)));
      this.diameter.set(this.brush.diameter);
      this.photoView.redraw();
    } else return false;
    return true;
  }

  keyUp(key) {
    if (key === " ") this.photoView.space = this.tileView.space = false;
  }
}
