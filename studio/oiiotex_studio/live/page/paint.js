// SPDX-License-Identifier: Apache-2.0
// Room Paint: a painting of the photo's labels becomes texture. A painting holds ids, so nothing is antialiased. A stroke
// is sent as a label and a mask, so that two pages can paint at once. There are two layers: coarse labels, and labels of
// the next finer map (0: none), each confined to the coarse label that contains it.

import { button, make, section, segments, slider, whole } from "./controls.js";
import { Output } from "./output.js";
import { Viewer, drawBrush, stroke } from "./viewer.js";
import { canvasOf } from "./wire.js";

const WHILE_PAINTING = 250; // ms between two previews of an unfinished stroke

export class PaintRoom {
  constructor(shell) {
    this.shell = shell;
    this.tool = "brush";
    this.size = [0, 0];
    this.layers = null; // coarse and fine, Uint8, of the painting's size
    this.mask = null; // of the stroke, Uint8, of the same size
    this.unsent = []; // strokes painted while disconnected
    this.labels = [];
    this.parents = []; // for each finer number the coarse labels that contain it
    this.open = false;
    this.build();
  }

  build() {
    const shared = {
      size: () => this.size,
      overlay: (context, viewer) => drawBrush(context, viewer, this.tool === "brush" ? this.shell.state.paint.brush : 3),
      paint: {
        active: () => this.layers !== null,
        down: (x, y, event) => this.down(x, y, event),
        move: (x, y, event) => this.move(x, y, event),
        up: () => this.up(),
      },
    };
    this.plan = make("canvas");
    this.texture = make("canvas");
    this.planView = new Viewer("Painting", { ...shared, draw: (context) => { context.imageSmoothingEnabled = false; context.drawImage(this.plan, 0, 0); } });
    this.textureView = new Viewer("Texture", { ...shared, draw: (context) => context.drawImage(this.texture, 0, 0) });
    for (const view of [this.planView, this.textureView]) {
      view.canvas.style.cursor = "crosshair";
      view.empty.hidden = false;
      view.empty.textContent = "Finding the labels of the photo ...";
    }
    this.tools = segments("Tool", [["brush", "Brush", "Paint with the chosen label (P)"], ["fill", "Fill", "Fill the connected area (G)"], ["pick", "Pick", "Pick the label under the pointer (I)"]], (tool) => this.setTool(tool));
    this.tools.set("brush");
    this.palette = make("div", { role: "group", ariaLabel: "Labels" });
    this.brush = slider("Size", { title: "Brush diameter, in pixels ([ and ]). Less pen pressure makes the brush smaller", low: 2, high: 1024, log: true, reset: 64, digits: 0, change: (brush) => this.set({ brush }) });
    this.controls = {
      width: whole("Width", { title: "Canvas width, in pixels. The painting is cropped or extended on the right. Can be undone", low: 64, high: 4096, change: (n) => this.set({ width: n ?? 1024 }) }),
      height: whole("Height", { title: "Canvas height, in pixels. The painting is cropped or extended at the bottom. Can be undone", low: 64, high: 4096, change: (n) => this.set({ height: n ?? 1024 }) }),
      seed: whole("Seed", { title: "Random seed of the choice of patches. Can be undone", low: 0, high: 4294967295, change: (n) => this.set({ seed: n ?? 0 }) }),
    };
    this.times = segments("Output size", [[1, "1 ×", "Size of the painting: exactly these pixels"], [4, "4 ×", "Four times the size, synthesized around the patches shown"], [16, "16 ×", "Sixteen times the size, synthesized around the patches shown"]], () => {});
    this.times.set(1);
    this.fact = make("p", { className: "hint" });
    this.output = new Output(this.shell, "painted", [button("Save", "Write the texture to the document's folder, in the background", () => this.ask({ do: "save", times: this.times.value })), this.times]);
    const panel = make("aside", {},
      section("Labels", this.palette),
      section("Tool", make("div", { className: "buttons", style: "margin:0 0 6px" }, this.tools), this.brush, this.fact),
      section("Painting", this.controls.width, this.controls.height, this.controls.seed, make("div", { className: "buttons" }, button("Open", "Open an image as a painting: palette colors or label ids, in the folder of the photo or the document", () => this.shell.ask("paint", { do: "paintings" })), button("New", "Fill the whole canvas with the chosen label. Can be undone", () => this.ask({ do: "new", label: this.shell.state.paint.label })))),
      this.output.element);
    this.opening = make("dialog", { ariaLabel: "Open a painting" });
    this.element = make("div", { className: "room" }, make("div", { className: "work" }, make("div", { className: "views" }, this.planView.element, this.textureView.element)), panel, this.opening);
  }

  ask(message, bytes) {
    this.asked = performance.now();
    if (message.do !== "save") delete this.element.dataset.step;
    return this.shell.ask("paint", message, bytes);
  }

  set(values) {
    this.shell.set("paint", values);
    this.refresh(false);
  }

  /** End a stroke when the room or the page is left. */
  hide() {
    for (const view of [this.planView, this.textureView]) view.letGo();
  }

  show() {
    if (this.open) return;
    this.open = true;
    this.ask({ do: "open" });
  }

  refresh(all) {
    const paint = this.shell.state?.paint;
    if (!paint) return;
    if (all && this.open && this.ask({ do: "open" })) for (const stroke of this.unsent.splice(0)) this.ask(...stroke);
    for (const [name, control] of Object.entries(this.controls)) control.set(paint[name]);
    this.brush.set(paint.brush);
    this.output.refresh();
    for (const group of this.palette.children) {
      const chosen = Number(group.dataset.label) === paint.label;
      group.classList.toggle("chosen", chosen);
      for (const one of group.querySelectorAll("button")) {
        const same = one.dataset.layer === paint.layer && (paint.layer === "coarse" || Number(one.dataset.finer) === paint.finer);
        one.setAttribute("aria-pressed", String(chosen && same));
      }
    }
  }

  // --- messages from the server ---

  frame(facts, bytes) {
    if (facts.kind === "palette") return this.showPalette(facts, canvasOf(facts, bytes));
    const [width, height] = facts.whole;
    if (width !== this.size[0] || height !== this.size[1]) {
      this.up(); // another page has resized the canvas: keep the stroke so far
      this.size = [width, height];
      for (const canvas of [this.plan, this.texture]) [canvas.width, canvas.height] = this.size;
      this.layers = { coarse: new Uint8Array(width * height), fine: new Uint8Array(width * height) };
      this.mask = new Uint8Array(width * height);
      for (const view of [this.planView, this.textureView]) view.fit();
    }
    if (facts.kind === "texture") {
      this.texture.getContext("2d").drawImage(canvasOf(facts, bytes), facts.left, facts.top);
      this.textureView.redraw();
    } else if (facts.kind === "ids") {
      const layer = this.layers[facts.layer];
      for (let y = 0, n = 0; y < facts.height; y++)
        for (let at = (facts.top + y) * width + facts.left, x = 0; x < facts.width; x++, at++, n++)
          if (!this.painting || !this.mask[at]) layer[at] = bytes[n]; // other pages do not overwrite an unfinished stroke
      this.drawPlan(facts.left, facts.top, facts.left + facts.width, facts.top + facts.height);
    }
    for (const view of [this.planView, this.textureView]) view.empty.hidden = true;
  }

  /** Show progress until the painting arrives. */
  waitFor(text) {
    if (text) for (const view of [this.planView, this.textureView]) view.empty.textContent = text;
  }

  hear(message) {
    if (message.do === "paintings") return this.offer(message.names);
    if (message.do !== "step") return;
    this.working = false;
    if (message.going) return;
    this.shell.status("");
    const took = this.asked ? `${Math.round(performance.now() - this.asked)} ms` : "";
    const change = message.change ? `: ${message.change}` : "";
    this.fact.textContent = `Step ${message.step} of ${message.last}${change}${took ? ` (${took})` : ""}`;
    this.element.dataset.step = String(message.step);
  }

  /** Show the list of images to open. */
  offer(names) {
    const text = names.length ? "Images in the folders of the photo and the document. A painting consists of palette colors or label ids:" : "There is no image in the folder of the photo or the document. Copy a painting there: a PNG in palette colors, or an EXR or TIFF of label ids.";
    const close = button("Close", "Close without opening an image", () => this.opening.close());
    const choose = (name) => { this.opening.close(); this.ask({ do: "bring", name }); };
    const files = names.map((name) => button(name, `Open ${name}`, () => choose(name)));
    this.opening.replaceChildren(make("p", { textContent: text }), make("div", { className: "files" }, ...files), make("form", {}, close));
    this.opening.showModal();
  }

  askLine() {
    this.shell.ask("paint", { do: "line" });
  }

  showPalette(facts, picture) {
    this.labels = facts.labels;
    this.colors = new Uint32Array(256).fill(0xff000000);
    this.dimmed = new Uint32Array(256).fill(0xff000000);
    this.finer = new Uint32Array(256);
    this.parents = [[]];
    const packed = (color, times) => color.split(",").reduce((sum, channel, n) => sum | (Math.round(times * Number(channel)) << (8 * n)), 0xff000000);
    for (const { id, color } of facts.labels) {
      this.colors[id] = packed(color, 1);
      this.dimmed[id] = packed(color, 0.4);
    }
    for (const { number, parents, color } of facts.finer) {
      this.finer[number] = packed(color, 1);
      this.parents[number] = parents;
    }
    const total = facts.labels.reduce((sum, one) => sum + one.area, 0);
    this.palette.replaceChildren(...facts.labels.map((label) => {
      const parts = facts.finer.filter((one) => one.parents.includes(label.id));
      const within = label.children.length > 1 ? parts : []; // a single finer label adds nothing to its coarse label
      const name = label.name.includes("/") ? `Label ${label.id}` : label.name;
      const one = button("", `Paint with label ${label.id}${within.length ? `, with ${within.length} finer labels` : ""}`, () => this.set({ layer: "coarse", label: label.id, finer: 0 }), { className: "swatch" });
      one.dataset.layer = "coarse";
      one.append(make("i", { style: `background:rgb(${label.color})` }), this.swatch(label, picture, 48, 28), make("b", { textContent: name }), make("small", { textContent: `${Math.round((100 * label.area) / total)} %` }));
      const finer = within.map((part) => this.finerSwatch(part, label, this.swatch(part, picture, 38, 24)));
      if (within.length) finer.push(this.finerSwatch({ number: 0 }, label, make("span", { textContent: "none" })));
      const group = make("div", { className: "entry" }, one, make("div", { className: "within", role: "group", ariaLabel: `Finer labels of ${name}` }, ...finer));
      group.dataset.label = label.id;
      return group;
    }));
    const { label, finer } = this.shell.state.paint;
    if (!facts.labels.some((one) => one.id === label)) this.set({ layer: "coarse", label: facts.labels[0].id, finer: 0 });
    else if (finer && !this.parents[finer]?.includes(label)) this.set({ layer: "coarse", finer: 0 });
    this.refresh(false);
    if (this.layers) this.drawPlan(0, 0, ...this.size);
  }

  /** A canvas with a part of the palette image. */
  swatch({ box: [left, top, width, height] }, picture, across, down) {
    const canvas = make("canvas", { width: across, height: down, style: `width:${across}px;height:${down}px` });
    const scale = Math.min(width / across, height / down);
    canvas.getContext("2d").drawImage(picture, left, top, across * scale, down * scale, 0, 0, across, down);
    return canvas;
  }

  /** A button that selects a finer label of a label, or none. */
  finerSwatch({ number, id, color }, label, face) {
    const title = number ? `Paint with finer label ${id}, only inside its coarse labels` : `Erase finer labels inside label ${label.id}`;
    const one = button("", title, () => this.set({ layer: "fine", label: label.id, finer: number }), { style: color ? `border-color:rgb(${color})` : "" });
    one.dataset.layer = "fine";
    one.dataset.finer = number;
    one.append(face);
    return one;
  }

  drawPlan(left, top, right, bottom) {
    const [width] = this.size;
    if (right <= left || bottom <= top || !this.colors) return;
    const image = new ImageData(right - left, bottom - top);
    const out = new Uint32Array(image.data.buffer);
    const { coarse, fine } = this.layers;
    for (let y = top, at = 0; y < bottom; y++) {
      for (let x = left; x < right; x++, at++) {
        const place = y * width + x;
        if (!fine[place]) out[at] = this.colors[coarse[place]];
        else out[at] = (x + y) & 8 ? this.finer[fine[place]] : this.dimmed[coarse[place]]; // hatched, because both layers can have the same color
      }
    }
    this.plan.getContext("2d").putImageData(image, left, top);
    this.planView.redraw();
  }

  // --- tools ---

  setTool(tool) {
    this.tool = tool;
    this.tools.set(tool);
  }

  down(x, y, event) {
    const [width, height] = this.size;
    const [column, row] = [Math.floor(x), Math.floor(y)];
    const inside = column >= 0 && row >= 0 && column < width && row < height;
    if (this.tool === "pick") {
      if (inside) this.pick(row * width + column);
    } else if (this.tool === "fill") {
      if (inside) this.send(this.begin().fill(column, row));
    } else {
      this.begin();
      this.painting = { last: [x, y], box: [width, height, 0, 0], told: performance.now() };
      this.move(x, y, event);
    }
  }

  /** Select the label at a pixel. */
  pick(at) {
    const [label, finer] = [this.layers.coarse[at], this.layers.fine[at]];
    this.set({ layer: finer ? "fine" : "coarse", label, finer });
  }

  /** Begin a stroke: fix its layer, its value, and which pixels it can change. */
  begin() {
    const { layer, label, finer } = this.shell.state.paint; // other pages can change these during the stroke
    const within = finer ? this.parents[finer] : [label];
    const allowed = layer === "fine" ? (at) => within.includes(this.layers.coarse[at]) : () => true;
    this.with = { layer, value: layer === "fine" ? finer : label, allowed };
    this.mask.fill(0);
    return this;
  }

  /** Remove finer labels in a box that lie outside their coarse labels, as the server does. */
  keepInside([left, top, right, bottom]) {
    const { coarse, fine } = this.layers;
    for (let y = top; y < bottom; y++)
      for (let at = y * this.size[0] + left; at < y * this.size[0] + right; at++) if (!this.parents[fine[at]].includes(coarse[at])) fine[at] = 0;
  }

  move(x, y, event) {
    if (!this.painting) return;
    const { brush } = this.shell.state.paint;
    const { layer, value, allowed } = this.with;
    const plane = this.layers[layer];
    const diameter = brush * (event.pointerType === "pen" ? Math.max(0.05, event.pressure) : 1);
    const box = stroke(this.mask, ...this.size, this.painting.last, [x, y], diameter, 1, allowed);
    for (let row = box[1]; row < box[3]; row++)
      for (let at = row * this.size[0] + box[0]; at < row * this.size[0] + box[2]; at++) if (this.mask[at]) plane[at] = value;
    this.keepInside(box);
    const before = this.painting.box;
    const all = [Math.min(before[0], box[0]), Math.min(before[1], box[1]), Math.max(before[2], box[2]), Math.max(before[3], box[3])];
    this.painting.box = all;
    this.painting.last = [x, y];
    this.drawPlan(...box);
    if (!this.working && performance.now() - this.painting.told > WHILE_PAINTING) {
      this.painting.told = performance.now();
      this.send(all, true);
    }
  }

  up() {
    if (!this.painting) return;
    const { box } = this.painting;
    this.painting = null;
    this.send(box);
  }

  /** Fill the connected area of the layer, inside the label, and return its box. */
  fill(column, row) {
    const [width, height] = this.size;
    const { layer, value, allowed } = this.with;
    const plane = this.layers[layer];
    const old = plane[row * width + column];
    if (old === value || !allowed(row * width + column)) return [0, 0, 0, 0];
    const fills = (at) => plane[at] === old && allowed(at);
    const box = [width, height, 0, 0];
    const waiting = [[column, row]];
    while (waiting.length) {
      const [x, y] = waiting.pop();
      if (!fills(y * width + x)) continue;
      let [left, right] = [x, x];
      while (left > 0 && fills(y * width + left - 1)) left--;
      while (right < width - 1 && fills(y * width + right + 1)) right++;
      plane.fill(value, y * width + left, y * width + right + 1);
      this.mask.fill(1, y * width + left, y * width + right + 1);
      for (const next of [y - 1, y + 1]) {
        if (next < 0 || next >= height) continue;
        for (let at = left; at <= right; at++) {
          const here = fills(next * width + at);
          if (here && (at === left || !fills(next * width + at - 1))) waiting.push([at, next]);
        }
      }
      box[0] = Math.min(box[0], left);
      box[1] = Math.min(box[1], y);
      box[2] = Math.max(box[2], right + 1);
      box[3] = Math.max(box[3], y + 1);
    }
    this.keepInside(box);
    this.drawPlan(...box);
    return box;
  }

  /** Send the stroke's mask in a box; `going`: the stroke is unfinished, and becomes one step with the rest. */
  send([left, top, right, bottom], going = false) {
    const [width, height] = [right - left, bottom - top];
    if (width <= 0 || height <= 0) return;
    const { layer, value } = this.with;
    const bytes = new Uint8Array(width * height);
    for (let y = 0; y < height; y++)
      bytes.set(this.mask.subarray((top + y) * this.size[0] + left, (top + y) * this.size[0] + right), y * width);
    const message = { do: "stroke", layer, value, left, top, width, height, going };
    this.working = this.ask(message, bytes);
    if (!this.working && !going) this.unsent.push([message, bytes]);
  }

  // --- keys ---

  key(key, event) {
    const views = [this.planView, this.textureView];
    if (key === " ") for (const view of views) view.space = true;
    else if (event.ctrlKey || event.metaKey) return false;
    else if (key === "f") for (const view of views) view.fit();
    else if (key === "p") this.setTool("brush");
    else if (key === "g") this.setTool("fill");
    else if (key === "i") this.setTool("pick");
    else if (key === "[" || key === "]") {
      this.set({ brush: Math.min(1024, Math.max(2, this.shell.state.paint.brush * (key === "[" ? 0.8 : 1.25))) });
      for (const view of views) view.redraw();
    } else return false;
    return true;
  }

  keyUp(key) {
    if (key === " ") for (const view of [this.planView, this.textureView]) view.space = false;
  }
}
