// SPDX-License-Identifier: Apache-2.0
// An image that pans and zooms: wheel, middle button, Space and drag, two fingers, arrows. The caller handles painting.

import { make } from "./controls.js";

const STEP = 48; // CSS px, of an arrow key

export class Viewer {
  /**
   * `draw(context, viewer)` draws in image coordinates; `size()` is [width, height] of the image. `unit()` is the
   * number of the file's pixels to one of these, for previews. `sampled(x, y)` is called with the pixel of the file
   * under the pointer, or in the middle of the view when a key moves it; with null when the pointer leaves.
   */
  constructor(name, { draw, size, overlay, paint, unit = () => 1, sampled = () => {} }) {
    this.canvas = make("canvas", { role: "img", ariaLabel: name, tabIndex: 0 });
    this.element = make("div", { className: "view" }, this.canvas);
    this.bar = make("div", { className: "bar" }, make("span", { className: "title", textContent: name }));
    this.empty = make("div", { className: "empty", hidden: true });
    this.element.append(this.bar, this.empty);
    this.drawing = draw;
    this.size = size;
    this.overlay = overlay;
    this.paint = paint;
    this.unit = unit;
    this.sampled = sampled;
    this.linked = null; // the viewer that pans and zooms with this one
    this.scale = 0;
    this.x = this.y = 0; // upper left corner of the image, CSS px
    this.fitted = true;
    this.space = false;
    this.pointers = new Map();
    this.painting = null; // id of the painting pointer
    new ResizeObserver(() => this.resized()).observe(this.element);
    this.listen();
  }

  resized() {
    const { clientWidth: width, clientHeight: height } = this.element;
    const ratio = devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(width * ratio));
    this.canvas.height = Math.max(1, Math.round(height * ratio));
    if (this.fitted) this.fit();
    this.redraw();
  }

  /** Fit the whole image into the view. */
  fit() {
    const [width, height] = this.size();
    const { clientWidth: w, clientHeight: h } = this.element;
    if (!width || !w) return;
    this.scale = Math.min((w - 24) / width, (h - 24) / height);
    this.x = (w - width * this.scale) / 2;
    this.y = (h - height * this.scale) / 2;
    this.fitted = true;
    this.moved();
  }

  /** Show a pixel of the file as one of the screen, around the middle of the view. */
  oneToOne() {
    const { clientWidth, clientHeight } = this.element;
    this.zoomAt(clientWidth / 2, clientHeight / 2, this.unit() / (devicePixelRatio || 1) / this.scale);
  }

  /** Draw at another place or scale, and let the linked viewer follow. */
  moved() {
    this.redraw();
    if (!this.linked || !this.linked.size()[0] || !this.scale) return;
    const { element, linked: other } = this;
    const ratio = other.unit() / this.unit();
    const middle = [(element.clientWidth / 2 - this.x) / this.scale / ratio, (element.clientHeight / 2 - this.y) / this.scale / ratio];
    other.scale = this.scale * ratio;
    other.x = other.element.clientWidth / 2 - middle[0] * other.scale;
    other.y = other.element.clientHeight / 2 - middle[1] * other.scale;
    other.fitted = false;
    other.redraw();
  }

  /** Link two viewers, or release them. */
  static link(one, other, linked) {
    one.linked = linked ? other : null;
    other.linked = linked ? one : null;
    if (linked) one.moved();
  }

  redraw() {
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => {
      this.pending = 0;
      this.drawNow();
    });
  }

  drawNow() {
    const context = this.canvas.getContext("2d");
    const ratio = this.canvas.width / Math.max(1, this.element.clientWidth);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = "#141414";
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    if (!this.size()[0]) return;
    if (!this.scale) this.fit();
    context.setTransform(ratio * this.scale, 0, 0, ratio * this.scale, ratio * this.x, ratio * this.y);
    context.imageSmoothingEnabled = this.scale < 2;
    context.imageSmoothingQuality = "high";
    this.drawing(context, this);
    if (this.overlay) {
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      this.overlay(context, this);
    }
  }

  /** Position of an event in image coordinates. */
  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left - this.x) / this.scale, (event.clientY - box.top - this.y) / this.scale];
  }

  zoomAt(x, y, factor) {
    const scale = Math.min(64, Math.max(0.02, this.scale * factor));
    this.x = x - ((x - this.x) * scale) / this.scale;
    this.y = y - ((y - this.y) * scale) / this.scale;
    this.scale = scale;
    this.fitted = false;
    this.moved();
  }

  /** Tell the pixel of the file at a place in CSS px. */
  sampleAt(x, y) {
    const unit = this.unit();
    this.sampled(Math.floor(((x - this.x) / this.scale) * unit), Math.floor(((y - this.y) / this.scale) * unit));
  }

  /** Move by a key; false if it is another one. */
  moveBy(key) {
    const { clientWidth: width, clientHeight: height } = this.element;
    const [dx, dy] = { ArrowLeft: [STEP, 0], ArrowRight: [-STEP, 0], ArrowUp: [0, STEP], ArrowDown: [0, -STEP] }[key] ?? [0, 0];
    const factor = { PageDown: 1.25, PageUp: 0.8 }[key] ?? 1;
    if (!dx && !dy && factor === 1) return false;
    this.x += dx;
    this.y += dy;
    this.zoomAt(width / 2, height / 2, factor);
    this.sampleAt(width / 2, height / 2);
    return true;
  }

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const box = canvas.getBoundingClientRect();
      this.zoomAt(event.clientX - box.left, event.clientY - box.top, Math.exp(-event.deltaY * 0.0015));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      if (!event.ctrlKey && !event.metaKey && this.size()[0] && this.moveBy(event.key)) event.preventDefault();
    });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
      const panning = event.button === 1 || this.space || this.pointers.size > 1 || !this.paint?.active();
      if (!panning && event.button === 0) {
        this.painting = event.pointerId;
        this.paint.down(...this.at(event), event);
      }
      event.preventDefault();
      canvas.focus();
    });
    canvas.addEventListener("pointermove", (event) => {
      this.pointer = this.at(event);
      const before = this.pointers.get(event.pointerId);
      if (this.painting === event.pointerId) {
        for (const one of event.getCoalescedEvents?.() ?? [event]) this.paint.move(...this.at(one), one);
      } else if (before) {
        this.x += event.clientX - before[0];
        this.y += event.clientY - before[1];
        this.fitted = false;
        if (this.pointers.size === 2) this.pinch(event);
        this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
        this.moved();
      }
      if (this.scale && !before) this.sampleAt(this.pointer[0] * this.scale + this.x, this.pointer[1] * this.scale + this.y);
      if (this.paint?.active()) this.redraw();
    });
    const end = (event) => {
      this.pointers.delete(event.pointerId);
      if (this.painting === event.pointerId) this.letGo();
    };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("pointerleave", () => { this.pointer = null; this.sampled(null); this.redraw(); });
    canvas.addEventListener("dblclick", () => { if (!this.paint?.active()) this.fit(); });
  }

  /** End a stroke while the pointer may still be down. */
  letGo() {
    if (this.painting === null) return;
    this.pointers.delete(this.painting); // the rest of the drag must not pan
    this.painting = null;
    this.paint.up();
  }

  pinch(event) {
    const [id, other] = [...this.pointers].find(([key]) => key !== event.pointerId);
    const before = this.pointers.get(event.pointerId);
    const far = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
    const box = this.canvas.getBoundingClientRect();
    this.zoomAt(other[0] - box.left, other[1] - box.top, far([event.clientX, event.clientY]) / Math.max(1, far(before)));
  }
}

/** Draw the outline of the round brush at the pointer. */
export function drawBrush(context, viewer, diameter) {
  if (!viewer.pointer || !viewer.paint?.active()) return;
  const [x, y] = viewer.pointer;
  context.beginPath();
  context.arc(x * viewer.scale + viewer.x, y * viewer.scale + viewer.y, (diameter / 2) * viewer.scale, 0, 7);
  context.strokeStyle = "#000";
  context.lineWidth = 3;
  context.stroke();
  context.strokeStyle = "#fff";
  context.lineWidth = 1;
  context.stroke();
}

/**
 * Draw a round brush along a line into a Uint8 plane, and return the changed box. Values are ids: no antialiasing.
 *
 * `allowed(index)` returns whether a pixel can be set.
 */
export function stroke(plane, width, height, from, to, diameter, value, allowed = () => true) {
  const radius = Math.max(0.5, diameter / 2);
  const left = Math.max(0, Math.floor(Math.min(from[0], to[0]) - radius));
  const right = Math.min(width, Math.ceil(Math.max(from[0], to[0]) + radius) + 1);
  const top = Math.max(0, Math.floor(Math.min(from[1], to[1]) - radius));
  const bottom = Math.min(height, Math.ceil(Math.max(from[1], to[1]) + radius) + 1);
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  const length = dx * dx + dy * dy;
  for (let y = top; y < bottom; y++) {
    for (let x = left; x < right; x++) {
      const [px, py] = [x + 0.5 - from[0], y + 0.5 - from[1]];
      const t = length ? Math.min(1, Math.max(0, (px * dx + py * dy) / length)) : 0;
      const [ex, ey] = [px - t * dx, py - t * dy];
      if (ex * ex + ey * ey <= radius * radius && allowed(y * width + x)) plane[y * width + x] = value;
    }
  }
  return [left, top, right, bottom];
}
