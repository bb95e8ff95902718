// SPDX-License-Identifier: Apache-2.0
// Room Tile: the photo next to its tile.

import { Compare } from "./compare.js";
import { button, choice, make, section, segments, slider, whole } from "./controls.js";
import { Inspect } from "./inspect.js";
import { Lit } from "./lit.js";
import { measuresOf } from "./measures.js";
import { Output } from "./output.js";
import { Regions } from "./regions.js";
import { drawPlane, mipmaps } from "./plane.js";
import { Strip } from "./strip.js";
import { Viewer, drawBrush } from "./viewer.js";
import { canvasOf } from "./wire.js";

const LET_GO = 60; // ms from the last change of a slider to the message to the server
const PATCHES = [5, 7, 9, 11, 13, 15, 17, 19, 21]; // px

export class TileRoom {
  constructor(shell) {
    this.shell = shell;
    this.photo = this.tile = null;
    this.size = [0, 0]; // of the full-size tile, px; previews are smaller
    this.mode = "2x2";
    this.waiting = {};
    this.doing = "Making the tile"; // while it is in progress
    this.build();
  }

  // --- elements ---

  build() {
    this.photoView = new Viewer("Photo", {
      size: () => (this.photo ? [this.photo.width, this.photo.height] : [0, 0]),
      unit: () => this.shell.facts.photo[0] / this.photo.width,
      sampled: (x, y) => this.inspect.sample("photo", x, y),
      draw: (context) => this.regions.draw(context),
      overlay: (context, viewer) => drawBrush(context, viewer, this.regions.brush.diameter),
      paint: {
        active: () => this.regions.brush.name !== "" && this.photo !== null,
        down: (x, y, event) => this.regions.strokeFrom(x, y, event),
        move: (x, y, event) => this.regions.strokeTo(x, y, event),
        up: () => this.regions.strokeEnds(),
      },
    });
    this.tileView = new Viewer("Tile", {
      size: () => (this.compare.shown().canvas ? this.compare.shown().size.map((n) => n * this.times()) : [0, 0]),
      sampled: (x, y) => this.inspect.sample("tile", x, y),
      draw: (context, viewer) => this.compare.draw(context, viewer, this.times()),
    });
    this.compare = new Compare(this);
    this.inspect = new Inspect(this);
    this.regions = new Regions(this);
    this.photoView.canvas.addEventListener("click", (event) => this.regions.pickLabel(event));
    this.planeCanvas = make("canvas", { role: "img", ariaLabel: "Tile on a plane", hidden: true });
    this.tileView.element.append(this.planeCanvas);
    new ResizeObserver(() => this.drawPlane()).observe(this.tileView.element);
    const maps = this.shell.facts.maps.length ? [["maps", "Maps", "All maps of the material (T)"], ["lit", "Lit", "The material on a plane, lit from the pointer (T)"]] : [];
    this.lit = maps.length ? new Lit(this) : null;
    this.layouts = [["1x1", "1 × 1", "One tile (T)"], ["2x2", "2 × 2", "Two by two tiles (T)"], ["plane", "Plane", "Perspective plane, to judge repetition (T)"], ...maps];
    this.modes = segments("Layout", this.layouts, (mode) => this.setMode(mode));
    this.fact = make("span", { className: "fact" });
    this.outdated = make("span", { className: "fact mark", hidden: true, title: "This picture belongs to earlier values. The new one is being made" });
    this.turn = this.wanted = 0; // of the tile that is shown, and of the one that is being made
    this.tileView.bar.append(this.modes, make("span", { className: "grow" }), this.outdated, this.fact);
    this.tileView.empty.textContent = "Making coarse tiles ...";
    this.tileView.empty.hidden = false;
    this.strip = new Strip(this);
    this.element = make("div", { className: "room" },
      make("div", { className: "work" }, make("div", { className: "views" }, this.photoView.element, this.tileView.element), make("div", { className: "shelf" }, this.strip.element, this.inspect.element)),
      this.panel());
    this.modes.set(this.mode);
    this.strip.show();
  }

  panel() {
    const set = (values) => this.set(values);
    const effective = (name) => this.chosen?.[name] ?? this.planned()[name];
    this.controls = {
      flattening: slider("Flattening", { title: "Fraction of the photo's gradients and stains to remove before synthesis. 0 copies the photo's pixels unchanged", low: 0, high: 1, step: 0.05, reset: null, automatic: () => 1, change: (flattening) => set({ flattening }) }),
      sigma: slider("Sigma", { title: "Scale, in pixels, above which the result is statistically uniform (MJH17)", low: 1, high: 512, log: true, reset: null, automatic: () => effective("sigma"), change: (sigma) => set({ sigma, evenness: null }) }),
      evenness: slider("Evenness", { title: "Perceived uniformity, an alternative to sigma: the matching sigma is measured on this photo (MJH17 section 4.4)", low: 0, high: 1, step: 0.05, reset: null, change: (evenness) => set({ evenness, sigma: null }) }),
      histogram: slider("Histogram", { title: "Weight of matching the photo's overall histogram", low: 0, high: 1, step: 0.05, reset: null, automatic: () => effective("histogram"), change: (histogram) => set({ histogram }) }),
      lattice: slider("Lattice", { title: "Weight of preserving a regular structure of the photo (courses, weaves)", low: 0, high: 1, step: 0.05, reset: 0.5, change: (lattice) => set({ lattice }) }),
      seed: whole("Seed", { title: "Random seed. The same seed gives the same pixels", low: 0, high: 4294967295, change: (seed) => set({ seed: seed ?? 0 }), extra: [button("Next", "Next seed (S)", () => this.nextSeed())] }),
      measure: choice("Measure", { title: "Statistics that are made uniform", options: [["histogram", "Histogram"], ["moments", "Moments"], ["steerable", "Steerable"]], change: (measure) => set({ measure }) }),
      preset: choice("Preset", { title: "Large: large structures are preserved. Even: structures larger than sigma are evened out. Clean: objects are removed. Layout: the layout of the photo is kept. Automatic: the photo decides", options: [[null, "Automatic"], ["even", "Even"], ["clean", "Clean"], ["large", "Large"], ["layout", "Layout"]], change: (preset) => set({ preset }) }),
      patch: choice("Patch", { title: "Patch size: detail up to this scale is copied unchanged", options: [], change: (patch) => set({ patch }) }),
      width: whole("Width", { title: "Width of the tile, in pixels. Empty: the photo's width", low: 16, high: 16384, automatic: () => this.shell.facts?.photo[0], change: (width) => set({ width }) }),
      height: whole("Height", { title: "Height of the tile, in pixels. Empty: the photo's height", low: 16, high: 16384, automatic: () => this.shell.facts?.photo[1], change: (height) => set({ height }) }),
      mask: choice("Source", { title: "Valid source pixels: the part of the photo that patches are copied from", options: [["", "Whole photo"], ["dominant", "Dominant texture"], ["brush", "Painted mask"]], change: (mask) => this.setMask(mask) }),
      fill: choice("Replace", { title: "Area to replace. A painted area is filled from Source (--texfill), with Patch, Lattice and Seed", options: [["", "Everything"], ["brush", "Painted area"]], change: (fill) => set({ fill }) }),
    };
    this.measures = make("div", { className: "measures", ariaLive: "polite" }, make("p", { className: "stale", textContent: "Measured when the tile is finished." }));
    this.output = new Output(this.shell, "tile", [button("Save", "Write the tile to the document's folder, in the background", () => { this.tell(); this.shell.ask("tile", { do: "save" }); })]);
    return make("aside", {},
      section("Texture", this.controls.preset, this.controls.flattening, this.controls.sigma, this.controls.evenness, this.controls.histogram, this.controls.lattice, this.controls.measure, this.controls.patch),
      section("Result", this.controls.seed, this.controls.width, this.controls.height,
        make("div", { className: "buttons" }, button("Keep variant", "Add these parameters to the variants below (V)", () => this.strip.keep()), button("Show seeds", "Preview eight more seeds at low resolution", () => this.strip.askSeeds()), button("Show presets", "Preview all presets with the other parameters, at low resolution", () => this.shell.ask("tile", { do: "presets" })))),
      section("Measures", this.measures),
      this.output.element,
      section("Regions", this.controls.mask, this.controls.fill, ...this.regions.elements));
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
    if (this.compare.showing) this.compare.show("");
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

  /** The first tile is made when the tab is first shown. */
  show() {
    this.shell.ask("tile", { do: "open" });
  }

  /** Send what the page's user has changed before leaving. */
  hide() {
    this.tell();
  }

  setMask(mask) {
    if (mask === "dominant") this.regions.showOver("dominant");
    this.set({ mask });
  }

  setMode(mode) {
    this.mode = mode;
    this.modes.set(mode);
    const plane = mode === "plane";
    this.planeCanvas.hidden = !plane;
    const maps = mode === "maps" || mode === "lit";
    this.tileView.canvas.hidden = plane || maps;
    this.mark();
    this.compare.bar.hidden = maps; // what it does is not shown there
    this.lit?.show(mode);
    this.compare.setWipe(this.compare.wipe);
    if (plane) this.drawPlane();
    else this.tileView.fit();
  }

  /** Mark a picture of earlier values, until its successor is there. */
  mark() {
    const maps = this.mode === "maps" || this.mode === "lit";
    const old = maps ? this.lit.color && this.lit.color !== this.tile : this.tile && this.turn < this.wanted;
    this.outdated.hidden = !old;
    this.outdated.textContent = maps && this.lit.given ? "The photo's maps" : "Outdated";
    this.tileView.element.classList.toggle("outdated", Boolean(old && this.turn < this.wanted));
  }

  times() {
    return this.mode === "1x1" ? 1 : 2;
  }

  /** Draw another tile than before. */
  picked() {
    this.levels = null;
    if (this.tileView.fitted) this.tileView.fit();
    this.tileView.redraw();
    this.drawPlane();
    this.inspect.draw();
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
      this.photo = this.shell.photo = Object.assign(canvasOf(facts, bytes), { histogram: facts.histogram });
      this.inspect.draw();
      for (const name of ["mask", "fill"]) {
        if (this.regions.planes[name]?.length !== facts.width * facts.height) this.regions.planes[name] = null;
      }
      if (this.photoView.fitted) this.photoView.fit();
      this.photoView.redraw();
    } else if (facts.kind === "tile") {
      this.tile = Object.assign(canvasOf(facts, bytes), { histogram: facts.histogram });
      const scale = facts.whole ? 1 : 0;
      this.whole = facts.whole;
      if (facts.whole) {
        this.doing = "Measuring the tile";
        this.shell.stage("tile", this.doing);
      }
      if (scale || !this.size[0]) this.size = facts.size;
      else this.size = this.sizeWhileCoarse(facts.size);
      this.fact.textContent = facts.whole ? `${facts.size[0]} × ${facts.size[1]}` : "coarse";
      this.tileView.empty.hidden = true;
      this.compare.taken();
      this.picked();
      this.lit?.draw(); // the exposure may have changed
      this.turn = facts.turn;
      this.mark();
      this.element.dataset.turn = String(facts.turn);
      this.element.dataset.tile = facts.whole ? "whole" : "coarse";
      if (this.strip.keeping) this.strip.keep();
      else if (facts.whole) this.strip.showThumbnail();
    } else if (facts.kind === "map") {
      this.lit.take(facts, bytes);
      this.mark();
      this.element.dataset[facts.given ? "given" : "maps"] = String(this.lit.maps.size);
    } else if (facts.kind === "seed") {
      this.strip.seeds.set(facts.seed, canvasOf(facts, bytes));
      this.strip.show();
    } else if (facts.kind === "preset") {
      this.strip.presets.set(facts.preset, canvasOf(facts, bytes));
      this.strip.show();
      this.tileView.empty.hidden = true;
      if (!this.tile) {
        this.picked();
        this.shell.status("Coarse tiles: point at one to see it large, click it to use it");
      }
    } else if (facts.kind === "measure") {
      this.inspect.take(facts, new Uint8Array(bytes));
      this.photoView.redraw();
      this.tileView.redraw();
    } else if (facts.kind === "brush") {
      this.regions.planes[facts.name] = new Uint8Array(bytes);
      this.photoView.redraw();
    } else if (facts.kind === "overlay") {
      this.regions.overlay = { ...facts, plane: new Uint8Array(bytes), canvas: null };
      this.regions.overlay.canvas = this.regions.tinted(this.regions.overlay);
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
    if (message.do === "sample") return this.inspect.hear(message);
    if (message.do !== "measures") return;
    this.inspect.ask(); // the tile is finished
    this.measures.replaceChildren(...measuresOf(message.lines));
    this.chosen = Object.fromEntries(message.chosen.split(":").filter(Boolean).map((word) => [word.split("=")[0], Number(word.split("=")[1])]));
    this.refresh(false);
  }

  /** Show why there is no tile. */
  fail(text) {
    this.tileView.empty.textContent = text;
  }

  busy(message) {
    this.wanted = message.turn;
    this.mark();
    if (message.done === 0) {
      this.tileView.empty.textContent = "Synthesizing the tile ...";
      this.doing = "Making the tile";
      this.chosen = null;
      for (const line of this.measures.querySelectorAll("p, table")) line.className = "stale";
    }
  }

  askLine() {
    this.tell();
    this.shell.ask("tile", { do: "line" });
  }

  // --- drawing ---

  drawPlane() {
    if (this.mode !== "plane" || !this.compare.shown().canvas) return;
    const { clientWidth, clientHeight } = this.tileView.element;
    if (!clientWidth) return;
    this.planeCanvas.width = clientWidth;
    this.planeCanvas.height = clientHeight;
    const { canvas, size } = this.compare.shown();
    this.levels ??= mipmaps(canvas);
    drawPlane(this.planeCanvas, this.levels, (clientWidth / size[0]) * 0.8);
  }

  // --- keys ---

  key(key, event) {
    if (key === " ") this.photoView.space = this.tileView.space = true;
    else if (event.ctrlKey || event.metaKey) return false;
    else if (key === "f") this.compare.fit();
    else if (key === "0") this.compare.oneToOne();
    else if (key === "l") this.compare.setLinked(!this.photoView.linked);
    else if (key === "w") this.compare.setWipe(this.compare.wipe === null ? 0.5 : null);
    else if (key === "a" || key === "b") {
      const name = key.toUpperCase();
      if (event.shiftKey) this.compare.store(name);
      else this.compare.show(this.compare.showing === name ? "" : name);
    }
    else if (key === "d" || key === "r") {
      const name = { d: "drift", r: "repetition" }[key];
      this.regions.showOver(this.regions.shownOver === name ? "" : name);
    }
    else if (key === "s") this.nextSeed();
    else if (key === "v") this.strip.keep();
    else if (key === "t") this.setMode(this.layouts[(this.layouts.findIndex(([mode]) => mode === this.mode) + 1) % this.layouts.length][0]);
    else if (key === "m") this.regions.showOver(this.regions.shownOver === "dominant" ? "" : "dominant");
    else if (key === "p") this.regions.take("brush");
    else if (key === "e") this.regions.take("erase");
    else if (key === "[" || key === "]") this.regions.scaleBrush(key === "[" ? 0.8 : 1.25);
    else return false;
    return true;
  }

  keyUp(key) {
    if (key === " ") this.photoView.space = this.tileView.space = false;
  }
}
