// SPDX-License-Identifier: Apache-2.0
// The strip below the photo and its tile: coarse tiles of the presets, variants that were kept, other seeds.

import { button, make } from "./controls.js";

const SEEDS = 8;
const PRESETS = [["", "Automatic"], ["even", "Even"], ["clean", "Clean"], ["large", "Large"], ["layout", "Layout"]];
// parameters that override a preset
const DECIDED = { sigma: null, evenness: null, patch: null, histogram: null };

export class Strip {
  constructor(room) {
    this.room = room;
    this.shell = room.shell;
    this.seeds = new Map(); // canvases
    this.presets = new Map(); // canvases by preset, "": none
    this.clicked = ""; // text of the thumbnail that was clicked last, until the pointer leaves
    this.element = make("div", { className: "strip" });
    this.element.addEventListener("pointerleave", () => { this.clicked = ""; });
  }

  askSeeds() {
    this.seeds.clear();
    this.show();
    this.shell.status("Eight previews: click one to use its seed");
    this.shell.ask("tile", { do: "seeds", first: this.shell.state.tile.seed + 1, count: SEEDS });
  }

  /** Add a variant with what is shown. A coarse picture is replaced when the tile is finished. */
  keep() {
    this.keeping = !this.room.tile;
    if (this.keeping) return this.shell.status("The variant is kept as soon as its first preview is shown");
    const list = [...this.shell.state.variants.list, { tile: { ...this.shell.state.tile }, thumbnail: this.thumbnail() }].slice(-64);
    this.shell.set("variants", { list });
    this.show();
  }

  thumbnail() {
    const canvas = make("canvas", { width: 84, height: 84 });
    const side = Math.min(this.room.tile.width, this.room.tile.height);
    canvas.getContext("2d").drawImage(this.room.tile, 0, 0, side, side, 0, 0, 84, 84);
    return canvas.toDataURL("image/jpeg", 0.8);
  }

  /** Show the finished tile in the last variant, if it has these parameters. */
  showThumbnail() {
    const { list } = this.shell.state.variants;
    const last = list.at(-1);
    if (!last || JSON.stringify(last.tile) !== JSON.stringify(this.shell.state.tile)) return;
    this.shell.set("variants", { list: [...list.slice(0, -1), { ...last, thumbnail: this.thumbnail() }] });
    this.show();
  }

  showVariants() {
    if (this.state() !== this.kept) this.show();
  }

  /** The state that the strip shows, as text. */
  state() {
    const { variants } = this.shell.state ?? {};
    return JSON.stringify([variants?.list.map((one) => one.tile), this.chosenPreset()]);
  }

  /** The preset that is in effect alone; undefined if other parameters override it. */
  chosenPreset() {
    const tile = this.shell.state?.tile;
    if (!tile) return undefined;
    return Object.keys(DECIDED).every((name) => tile[name] === null) ? tile.preset ?? "" : undefined;
  }

  /** A button with a picture, which the view shows while the pointer or the focus is on it. */
  thumb(title, canvas, text, click) {
    const { compare } = this.room;
    const one = button("", title, () => { this.clicked = text; compare.peek(null); click(); }, { className: "thumb" });
    one.append(canvas, make("span", { textContent: text }));
    const begins = () => {
      if (text === this.clicked) return; // its tile is shown instead, although the pointer is still there
      this.clicked = "";
      compare.peek(canvas);
    };
    for (const begin of ["pointerenter", "focus"]) one.addEventListener(begin, begins);
    for (const end of ["pointerleave", "blur"]) one.addEventListener(end, () => compare.peek(null));
    return one;
  }

  show() {
    const focused = [...this.element.querySelectorAll("button")].indexOf(document.activeElement);
    const list = this.shell.state?.variants.list ?? [];
    this.kept = this.state();
    const presets = PRESETS.filter(([preset]) => this.presets.has(preset)).map(([preset, title]) => {
      const one = this.thumb(`Use the preset ${title}`, this.presets.get(preset), title, () => this.room.set({ ...DECIDED, preset: preset || null }));
      one.setAttribute("aria-pressed", String(this.chosenPreset() === preset));
      return one;
    });
    const seeds = [...this.seeds].map(([seed, canvas]) => this.thumb(`Use seed ${seed}`, canvas, `seed ${seed}`, () => this.room.set({ seed })));
    const variants = list.map((variant, n) => {
      const one = button("", "Click to use these parameters, right-click to remove the variant", () => this.room.set(variant.tile), { className: "thumb" });
      one.append(make("img", { src: variant.thumbnail, alt: `Variant ${n + 1}` }), make("span", { textContent: this.caption(variant.tile) }));
      one.addEventListener("contextmenu", (event) => {
        event.preventDefault();
        this.shell.set("variants", { list: list.filter((_, m) => m !== n) });
        this.show();
      });
      return one;
    });
    const group = (caption, what, none) => make("div", { className: "group" }, make("span", { className: "caption", textContent: caption }), ...(what.length ? what : [make("span", { className: "hint", textContent: none })]));
    this.element.replaceChildren(group("Presets", presets, "Coarse tiles of the presets ..."), group("Variants", variants, "Press V to keep a variant"), group("Seeds", seeds, "Press Show seeds"));
    this.element.querySelectorAll("button")[focused]?.focus();
    this.room.compare.peek(null);
  }

  caption(tile) {
    const size = tile.evenness !== null ? `a ${tile.evenness}` : tile.sigma !== null ? `σ ${tile.sigma}` : "auto";
    return `${size} #${tile.seed}`;
  }
}
