// SPDX-License-Identifier: Apache-2.0
// Room Paint: labels of the photo are painted, and become its texture. Values of the painting are ids: nothing is
// antialiased, and what the server is told of a stroke are the ids of its box.

import { button, make, section, segments, slider, whole } from "./controls.js";
import { Viewer, drawBrush, stroke } from "./viewer.js";
import { canvasOf } from "./wire.js";

const WHILE_PAINTING = 250; // ms between two looks at a stroke that goes on

export class PaintRoom {
  constructor(shell) {
    this.shell = shell;
    this.tool = "brush";
    this.size = [0, 0];
    this.ids = null;
    this.labels = [];
    this.open = false;
    this.build();
  }

  build() {
    const shared = {
      size: () => this.size,
      overlay: (context, viewer) => drawBrush(context, viewer, this.tool === "brush" ? this.shell.state.paint.brush : 3),
      paint: {
        active: () => this.ids !== null,
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
      view.empty.textContent = "The photo's labels are looked for: this takes some seconds";
    }
    this.tools = segments("Tool", [["brush", "Brush", "Paint with the chosen label (B)"], ["fill", "Fill", "Fill what hangs together (G)"], ["pick", "Pick", "Choose the label under the pointer (I)"]], (tool) => this.setTool(tool));
    this.tools.set("brush");
    this.undo = button("Undo", "One step back (Ctrl Z)", () => this.ask({ do: "undo" }));
    this.redo = button("Redo", "One step forward (Ctrl Shift Z)", () => this.ask({ do: "redo" }));
    this.palette = make("div", { role: "group", ariaLabel: "Labels" });
    this.brush = slider("Size", { title: "Diameter in px ([ and ]); a pen's pressure makes it smaller", low: 2, high: 1024, log: true, reset: 64, digits: 0, change: (brush) => this.set({ brush }) });
    this.controls = {
      width: whole("Width", { title: "Of the painting in px. Another size is a new painting", low: 64, high: 4096, change: (n) => this.set({ width: n ?? 1024 }) }),
      height: whole("Height", { title: "Of the painting in px. Another size is a new painting", low: 64, high: 4096, change: (n) => this.set({ height: n ?? 1024 }) }),
      seed: whole("Seed", { title: "Another seed is a new painting", low: 0, high: 4294967295, change: (n) => this.set({ seed: n ?? 0 }) }),
    };
    this.times = segments("Times larger", [[1, "1 ×", "As large as the painting: exactly these pixels"], [4, "4 ×", "Sewn anew, four times larger"], [16, "16 ×", "Sewn anew, sixteen times larger"]], () => {});
    this.times.set(1);
    this.fact = make("p", { className: "hint" });
    const panel = make("aside", {},
      section("Labels", this.palette),
      section("Tool", make("div", { className: "buttons", style: "margin:0 0 6px" }, this.tools), this.brush, make("div", { className: "buttons" }, this.undo, this.redo), this.fact),
      section("Painting", this.controls.width, this.controls.height, this.controls.seed, make("div", { className: "buttons" }, button("Save", "Write the texture as a file beside the document, in the background", () => this.ask({ do: "save", times: this.times.value })), this.times, button("New", "All of it in the chosen label; the history is forgotten", () => this.ask({ do: "new", label: this.shell.state.paint.label })))));
    this.element = make("div", { className: "room" }, make("div", { className: "work" }, make("div", { className: "views" }, this.planView.element, this.textureView.element)), panel);
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

  show() {
    if (this.open) return;
    this.open = true;
    this.ask({ do: "open" });
  }

  refresh(all) {
    const paint = this.shell.state?.paint;
    if (!paint) return;
    if (all && this.open) this.ask({ do: "open" });
    for (const [name, control] of Object.entries(this.controls)) control.set(paint[name]);
    this.brush.set(paint.brush);
    for (const one of this.palette.children) one.setAttribute("aria-pressed", String(Number(one.dataset.label) === paint.label));
  }

  // --- what comes ---

  frame(facts, bytes) {
    if (facts.kind === "palette") return this.showPalette(facts, canvasOf(facts, bytes));
    const [width, height] = facts.whole;
    if (width !== this.size[0] || height !== this.size[1]) {
      this.size = [width, height];
      for (const canvas of [this.plan, this.texture]) [canvas.width, canvas.height] = this.size;
      this.ids = new Uint8Array(width * height);
      for (const view of [this.planView, this.textureView]) view.fit();
    }
    if (facts.kind === "texture") {
      this.texture.getContext("2d").drawImage(canvasOf(facts, bytes), facts.left, facts.top);
      this.textureView.redraw();
    } else if (facts.kind === "ids" && !this.painting) {
      for (let y = 0; y < facts.height; y++)
        this.ids.set(bytes.subarray(y * facts.width, (y + 1) * facts.width), (facts.top + y) * width + facts.left);
      this.drawPlan(facts.left, facts.top, facts.left + facts.width, facts.top + facts.height);
    }
    for (const view of [this.planView, this.textureView]) view.empty.hidden = true;
  }

  hear(message) {
    if (message.do !== "step") return;
    this.working = false;
    if (message.going) return;
    this.shell.status("");
    this.undo.disabled = message.step <= 0;
    this.redo.disabled = message.step >= message.last;
    const took = this.asked ? `${Math.round(performance.now() - this.asked)} ms` : "";
    this.fact.textContent = `Step ${message.step} of ${message.last}${took ? `, ${took}` : ""}`;
    this.element.dataset.step = String(message.step);
  }

  askLine() {
    this.shell.ask("paint", { do: "line" });
  }

  showPalette(facts, picture) {
    this.labels = facts.labels;
    this.colours = new Uint32Array(256).fill(0xff000000);
    for (const { id, colour } of facts.labels) {
      const [red, green, blue] = colour.split(",").map(Number);
      this.colours[id] = 0xff000000 | red | (green << 8) | (blue << 16);
    }
    const total = facts.labels.reduce((sum, one) => sum + one.area, 0);
    this.palette.replaceChildren(...facts.labels.map((label) => {
      const [left, top, width, height] = label.box;
      const swatch = make("canvas", { width: 48, height: 28, style: "width:48px;height:28px" });
      swatch.getContext("2d").drawImage(picture, left, top, Math.min(width, 84), Math.min(height, 48), 0, 0, 48, 28);
      const children = label.children.length ? `, ${label.children.length} within` : "";
      const one = button("", `Paint with label ${label.id}${children}`, () => this.set({ label: label.id }), { className: "swatch" });
      one.dataset.label = label.id;
      one.append(make("i", { style: `background:rgb(${label.colour})` }), swatch, make("b", { textContent: label.name.includes("/") ? `Label ${label.id}` : label.name }), make("small", { textContent: `${Math.round((100 * label.area) / total)} %` }));
      return one;
    }));
    if (!facts.labels.some((one) => one.id === this.shell.state.paint.label)) this.set({ label: facts.labels[0].id });
    this.refresh(false);
    if (this.ids) this.drawPlan(0, 0, ...this.size);
  }

  drawPlan(left, top, right, bottom) {
    const [width] = this.size;
    if (right <= left || bottom <= top || !this.colours) return;
    const image = new ImageData(right - left, bottom - top);
    const out = new Uint32Array(image.data.buffer);
    for (let y = top, at = 0; y < bottom; y++) for (let x = left; x < right; x++, at++) out[at] = this.colours[this.ids[y * width + x]];
    this.plan.getContext("2d").putImageData(image, left, top);
    this.planView.redraw();
  }

  // --- tools ---

  setTool(tool) {
    this.tool = tool;
    this.tools.set(tool);
  }

  down(x, y, event) {
    const { label } = this.shell.state.paint;
    const [width, height] = this.size;
    const [column, row] = [Math.floor(x), Math.floor(y)];
    const inside = column >= 0 && row >= 0 && column < width && row < height;
    if (this.tool === "pick") {
      if (inside) this.set({ label: this.ids[row * width + column] });
    } else if (this.tool === "fill") {
      if (inside) this.send(this.fill(column, row, label));
    } else {
      this.painting = { last: [x, y], box: [width, height, 0, 0], told: performance.now() };
      this.move(x, y, event);
    }
  }

  move(x, y, event) {
    if (!this.painting) return;
    const { brush, label } = this.shell.state.paint;
    const diameter = brush * (event.pointerType === "pen" ? Math.max(0.05, event.pressure) : 1);
    const box = stroke(this.ids, ...this.size, this.painting.last, [x, y], diameter, label);
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

  /** Fill what hangs together; its box. */
  fill(column, row, label) {
    const [width, height] = this.size;
    const old = this.ids[row * width + column];
    if (old === label) return [0, 0, 0, 0];
    const box = [width, height, 0, 0];
    const waiting = [[column, row]];
    while (waiting.length) {
      const [x, y] = waiting.pop();
      if (this.ids[y * width + x] !== old) continue;
      let [left, right] = [x, x];
      while (left > 0 && this.ids[y * width + left - 1] === old) left--;
      while (right < width - 1 && this.ids[y * width + right + 1] === old) right++;
      this.ids.fill(label, y * width + left, y * width + right + 1);
      for (const next of [y - 1, y + 1]) {
        if (next < 0 || next >= height) continue;
        for (let at = left; at <= right; at++) {
          const here = this.ids[next * width + at] === old;
          if (here && (at === left || this.ids[next * width + at - 1] !== old)) waiting.push([at, next]);
        }
      }
      box[0] = Math.min(box[0], left);
      box[1] = Math.min(box[1], y);
      box[2] = Math.max(box[2], right + 1);
      box[3] = Math.max(box[3], y + 1);
    }
    this.drawPlan(...box);
    return box;
  }

  /** Tell the server the ids of a box; `going`: the stroke goes on, and the whole of it will be one step. */
  send([left, top, right, bottom], going = false) {
    const [width, height] = [right - left, bottom - top];
    if (width <= 0 || height <= 0) return;
    const bytes = new Uint8Array(width * height);
    for (let y = 0; y < height; y++)
      bytes.set(this.ids.subarray((top + y) * this.size[0] + left, (top + y) * this.size[0] + right), y * width);
    this.working = true;
    this.ask({ do: "stroke", left, top, width, height, going }, bytes);
  }

  // --- keys ---

  key(key, event) {
    const views = [this.planView, this.textureView];
    if (key === " ") for (const view of views) view.space = true;
    else if (key === "z" && (event.ctrlKey || event.metaKey)) this.ask({ do: event.shiftKey ? "redo" : "undo" });
    else if (event.ctrlKey || event.metaKey) return false;
    else if (key === "f") for (const view of views) view.fit();
    else if (key === "b") this.setTool("brush");
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
