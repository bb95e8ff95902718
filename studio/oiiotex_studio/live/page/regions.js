// SPDX-License-Identifier: Apache-2.0
// What is drawn over the photo: labels, the dominant texture, measures, and masks that are painted with a brush.

import { button, make, segments, slider } from "./controls.js";
import { stroke } from "./viewer.js";

export class Regions {
  constructor(room) {
    this.room = room;
    this.shell = room.shell;
    this.brush = { name: "", tool: "brush", diameter: 48 };
    this.planes = { mask: null, fill: null }; // Uint8, at the photo's preview size
    this.shownOver = "";
    this.overlay = null;
    this.overlays = segments("Overlay", [["", "Photo", "Photo without overlay"], ["dominant", "Dominant", "Overlay of the dominant texture (LDR09) (M)"], ["label", "Labels", "Overlay of the coarsest label map (LSA16)"],
      ["drift", "Drift", "False color: how much local statistics differ from the rest, as in gradients and stains (D)"], ["repetition", "Repetition", "False color: how often a region of the photo is used (R)"]], (name) => this.showOver(name));
    this.overlays.set("");
    this.room.photoView.bar.append(this.overlays);
    this.tools = segments("Brush", [["", "Off", "No brush"], ["mask", "Source", "Paint the valid source pixels (P)"], ["fill", "Replace", "Paint the area to replace"]], (name) => this.setBrush(name));
    this.erase = button("Erase", "The brush erases (E)", () => this.setTool(this.brush.tool === "erase" ? "brush" : "erase"));
    this.diameter = slider("Size", { title: "Brush diameter, in pixels of the photo ([ and ])", low: 2, high: 400, log: true, reset: 48, digits: 0, change: (diameter) => { this.brush.diameter = diameter; } });
    this.diameter.set(48);
    this.tools.set("");
    this.elements = [
      make("div", { className: "row" }, make("span", { className: "label", textContent: "Paint" }), make("span", { className: "wide" }, this.tools)), this.diameter,
      make("div", { className: "buttons" }, this.erase, button("Clear", "Erase everything painted", () => this.fill(0)), button("Invert", "Invert the painted mask", () => this.fill(null))),
    ];
  }

  draw(context) {
    const { width, height } = this.room.photo;
    context.drawImage(this.room.inspect.picture("photo", this.room.photo), 0, 0, width, height);
    if (this.overlay && this.overlay.name === this.shownOver) context.drawImage(this.overlay.canvas, 0, 0, width, height);
    const name = this.brush.name || (this.shell.state.tile.mask === "brush" ? "mask" : this.shell.state.tile.fill ? "fill" : "");
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

  showOver(name) {
    this.shownOver = name;
    this.overlays.set(name);
    this.room.inspect.show(name);
    if (["dominant", "label"].includes(name) && this.overlay?.name !== name) {
      this.shell.status(name === "dominant" ? "Finding the dominant texture ..." : "Finding labels ...");
      this.shell.ask("tile", { do: "overlay", name });
    }
    this.setBrush(name ? "" : this.brush.name);
    this.room.tileView.redraw();
  }

  /** Use the label under the pointer as the only source. */
  pickLabel(event) {
    if (this.shownOver !== "label" || this.overlay?.name !== "label") return;
    const { plane, width, height } = this.overlay;
    const [x, y] = this.room.photoView.at(event);
    const [column, row] = [Math.floor((x * width) / this.room.photo.width), Math.floor((y * height) / this.room.photo.height)];
    if (column < 0 || row < 0 || column >= width || row >= height) return;
    const label = plane[row * width + column];
    if (label) this.room.set({ mask: label });
  }

  // --- the brush ---

  setBrush(name) {
    this.brush.name = this.shownOver === "label" ? "" : name;
    this.tools.set(this.brush.name);
    if (this.brush.name && this.shownOver) this.showOver("");
    this.room.photoView.canvas.style.cursor = this.brush.name ? "none" : "";
    this.room.photoView.redraw();
  }

  /** Paint or erase with the brush that was last used. */
  take(tool) {
    this.setTool(tool);
    this.setBrush(this.brush.name || "mask");
  }

  scaleBrush(factor) {
    this.brush.diameter = Math.min(400, Math.max(2, this.brush.diameter * factor));
    this.diameter.set(this.brush.diameter);
    this.room.photoView.redraw();
  }

  setTool(tool) {
    this.brush.tool = tool;
    this.erase.setAttribute("aria-pressed", String(tool === "erase"));
  }

  plane() {
    const { name } = this.brush;
    this.planes[name] ??= new Uint8Array(this.room.photo.width * this.room.photo.height);
    return this.planes[name];
  }

  strokeFrom(x, y, event) {
    this.last = [x, y];
    this.strokeTo(x, y, event);
  }

  strokeTo(x, y, event) {
    const pressure = event.pointerType === "pen" ? Math.max(0.05, event.pressure) : 1;
    stroke(this.plane(), this.room.photo.width, this.room.photo.height, this.last, [x, y], this.brush.diameter * pressure, this.brush.tool === "erase" ? 0 : 255);
    this.last = [x, y];
    this.tintStale = true;
    this.room.photoView.redraw();
  }

  strokeEnds() {
    this.sendBrush(this.brush.name);
  }

  /** Send a painted plane, and use it. */
  sendBrush(name) {
    this.shell.ask("tile", { do: "brush", name }, this.planes[name]);
    this.tintStale = true;
    this.room.photoView.redraw();
    if (this.shell.state.tile[name] !== "brush") this.room.set({ [name]: "brush" });
    this.room.tell(); // with the stroke, so that none arrives without the other
  }

  fill(value) {
    if (!this.brush.name) return this.shell.status("First choose what to paint: Source or Replace");
    const plane = this.plane();
    if (value === null) for (let n = 0; n < plane.length; n++) plane[n] = 255 - plane[n];
    else plane.fill(value);
    this.sendBrush(this.brush.name);
  }
}
