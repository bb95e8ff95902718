// SPDX-License-Identifier: Apache-2.0
// The strip below the photo and its tile: variants that were kept, and previews of other seeds.

import { button, make } from "./controls.js";

const SEEDS = 8;

export class Strip {
  constructor(room) {
    this.room = room;
    this.shell = room.shell;
    this.seeds = new Map(); // canvases
    this.element = make("div", { className: "strip" });
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
    if (this.keeping) return this.shell.status("The variant will be kept when its first preview is there");
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
    const kept = JSON.stringify(this.shell.state.variants.list.map((one) => one.tile));
    if (kept !== this.kept) this.show();
  }

  show() {
    const list = this.shell.state?.variants.list ?? [];
    this.kept = JSON.stringify(list.map((one) => one.tile));
    const seeds = [...this.seeds].map(([seed, canvas]) => {
      const one = button("", `Use seed ${seed}`, () => this.room.set({ seed }), { className: "thumb" });
      one.append(canvas, make("span", { textContent: `seed ${seed}` }));
      return one;
    });
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
    this.element.replaceChildren(group("Variants", variants, "Press V to keep a variant"), group("Seeds", seeds, "Show seeds previews eight more seeds"));
  }

  caption(tile) {
    const size = tile.amount !== null ? `a ${tile.amount}` : tile.sigma !== null ? `σ ${tile.sigma}` : "auto";
    return `${size} #${tile.seed}`;
  }
}
