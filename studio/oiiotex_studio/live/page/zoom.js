// SPDX-License-Identifier: Apache-2.0
// Room Zoom: an unbounded plane. Positions are BigInts in units of 1/2^96 root pixel, so sixty octaves need no rounding.
// Drawing uses distances from the center of the view, for which doubles are exact enough.

import { button, make, section, slider, whole } from "./controls.js";
import { canvasOf } from "./wire.js";

const BITS = 96n;
const SIDE = 256;
const MOST = 60;
const KEPT = 700; // tiles
const COARSER = 3; // octaves; a tile of that level stands for 64
const AHEAD = 400; // ms from a move to the message to the server

const big = (n) => BigInt(Math.round(n));
const floorDivide = (a, b) => (a - (((a % b) + b) % b)) / b;

/** Zoom, x and y from the address, or null where it has no position. */
function linkedPlace() {
  const found = /^#zoom\/(\d{1,3}(?:\.\d*)?)\/(-?\d{1,60})\/(-?\d{1,60})$/.exec(location.hash);
  return found && [Math.min(MOST, Number(found[1])), BigInt(found[2]), BigInt(found[3])];
}

/** The mean color of a tile, as CSS. */
function meanColor(tile) {
  const context = make("canvas", { width: 1, height: 1 }).getContext("2d");
  context.imageSmoothingQuality = "high";
  context.drawImage(tile, 0, 0, 1, 1);
  const [red, green, blue] = context.getImageData(0, 0, 1, 1).data;
  return `rgb(${red}, ${green}, ${blue})`;
}

export class ZoomRoom {
  constructor(shell) {
    this.shell = shell;
    this.tiles = new Map(); // "level/x/y" -> canvas
    this.x = this.y = 0n;
    this.zoom = 0;
    this.build();
    this.linked = linkedPlace();
  }

  build() {
    this.canvas = make("canvas", { role: "img", ariaLabel: "Unbounded texture", tabIndex: 0 });
    this.view = make("div", { className: "view" }, this.canvas);
    const bar = make("div", { className: "bar" }, make("span", { className: "title", textContent: "Plane" }), this.where = make("span", { className: "fact" }));
    this.empty = make("div", { className: "empty", textContent: "Synthesizing the plane ..." });
    this.view.append(bar, this.empty);
    this.controls = {
      seed: whole("Seed", { title: "Random seed. The same seed gives the same plane", low: 0, high: 4294967295, change: (seed) => this.set({ seed: seed ?? 0 }) }),
      jitter: slider("Jitter", { title: "Randomness of all levels (HRRG08 section 4.3). Reduce it where structures break, increase it where the exemplar repeats", low: 0, high: 1, step: 0.05, reset: null, automatic: () => 0.6, change: (jitter) => this.set({ jitter }) }),
      frames: whole("Frames", { title: "Number of frames of the path", low: 2, high: 65536, change: (frames) => this.set({ frames: frames ?? 96 }) }),
    };
    this.lock = button("Lock exemplar", "No jitter up to the exemplar's own resolution: the photo is kept and only finer detail is added", () => this.set({ keeplayout: this.shell.state.zoom.keeplayout ? 0 : 1 }));
    this.keys = make("div");
    const panel = make("aside", {},
      section("Position", make("div", { className: "buttons" }, button("Home", "Return to the start (F)", () => this.home()), button("In", "Zoom in by one octave (Page Down)", () => this.fly(1)), button("Out", "Zoom out by one octave (Page Up)", () => this.fly(-1))),
        make("p", { className: "hint", textContent: "Drag to pan, scroll to zoom. The address of the page is a permanent link to this position." })),
      section("Plane", this.controls.seed, this.controls.jitter, make("div", { className: "buttons" }, this.lock)),
      section("Path", this.keys, this.controls.frames, make("div", { className: "buttons" }, button("Add keyframe", "Add this position to the path (K)", () => this.addKey()), button("Clear", "Remove all keyframes", () => this.set({ keys: [] })), button("Copy path command", "Copy the command that renders the path (P)", () => this.shell.ask("zoom", { do: "path" })))));
    this.element = make("div", { className: "room" }, make("div", { className: "work" }, make("div", { className: "views" }, this.view)), panel);
    new ResizeObserver(() => this.resized()).observe(this.view);
    this.listen();
  }

  set(values) {
    this.shell.set("zoom", values);
    this.refresh(false);
  }

  refresh(all) {
    const zoom = this.shell.state?.zoom;
    if (!zoom) return;
    if (all) {
      if (this.linked) {
        [this.zoom, this.x, this.y] = this.linked;
        this.linked = null;
      } else if (!this.started) {
        [this.x, this.y, this.zoom] = [BigInt(zoom.x), BigInt(zoom.y), zoom.zoom];
        this.begin = this.begin ?? [this.x, this.y, this.zoom];
      }
      this.started = true;
      this.asked = "";
    }
    for (const [name, control] of Object.entries(this.controls)) control.set(zoom[name]);
    this.lock.setAttribute("aria-pressed", String(Boolean(zoom.keeplayout)));
    this.keys.replaceChildren(...(zoom.keys.length
      ? zoom.keys.map((key, n) => {
        const one = button(`${n + 1}. ${key.zoom.toFixed(2)} octaves`, "Go to this keyframe", () => { [this.x, this.y, this.zoom] = [BigInt(key.x), BigInt(key.y), key.zoom]; this.moved(); });
        one.style.margin = "0 4px 4px 0";
        return one;
      })
      : [make("p", { className: "hint", textContent: "The path starts at the zoom of the first keyframe and ends at the position and zoom of the last." })]));
    this.redraw();
  }

  // --- moving ---

  show() {
    this.resized();
    if (!this.linked) this.link();
  }

  /** Move to the position that was entered into the address. */
  follow() {
    this.linked = linkedPlace();
    if (!this.linked || !this.started) return;
    this.refresh(true);
    this.moved();
  }

  hide() {
    this.shell.ask("zoom", { do: "tiles", tiles: [] });
    this.asked = "";
  }

  resized() {
    const ratio = devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(this.view.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.view.clientHeight * ratio));
    this.redraw();
  }

  /** Size of a canvas pixel, in 1/2^96 root pixel. */
  unit() {
    const whole = Math.floor(this.zoom);
    // 2^(BITS - zoom) in two factors: the fraction as 53 bits, the rest as a shift
    return big(2 ** (whole - this.zoom) * 2 ** 52) << (BITS - 52n - BigInt(whole));
  }

  move(dx, dy) {
    const unit = this.unit();
    this.x += (unit * big(dx * 1024)) >> 10n;
    this.y += (unit * big(dy * 1024)) >> 10n;
    this.moved();
  }

  zoomAt(px, py, octaves) {
    const [cx, cy] = [px - this.canvas.width / 2, py - this.canvas.height / 2];
    const before = this.unit();
    this.zoom = Math.min(MOST, Math.max(0, this.zoom + octaves));
    const change = before - this.unit();
    this.x += (change * big(cx * 1024)) >> 10n;
    this.y += (change * big(cy * 1024)) >> 10n;
    this.moved();
  }

  fly(octaves) {
    this.zoom = Math.min(MOST, Math.max(0, Math.round(this.zoom) + octaves));
    this.moved();
  }

  home() {
    if (this.begin) [this.x, this.y, this.zoom] = this.begin;
    this.moved();
  }

  moved() {
    this.redraw();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.tellPlace();
      this.link();
    }, AHEAD);
  }

  tellPlace() {
    clearTimeout(this.timer);
    this.shell.set("zoom", { x: String(this.x), y: String(this.y), zoom: this.zoom });
  }

  link() {
    history.replaceState(null, "", `#zoom/${this.zoom}/${this.x}/${this.y}`);
  }

  // --- tiles ---

  /** The visible level, its scale on the canvas, and its tiles, the most central first. */
  sight() {
    const { width, height } = this.canvas;
    const level = Math.min(MOST, Math.max(0, Math.ceil(this.zoom - 0.25)));
    const scale = 2 ** (this.zoom - level); // canvas px per level px
    const tile = BigInt(SIDE) << (BITS - BigInt(level)); // side, in 1/2^96 root pixel
    const middle = [this.x, this.y].map((at) => {
      const index = floorDivide(at, tile);
      return { index, inside: (Number(((at - index * tile) << 30n) / tile) / 2 ** 30) * SIDE };
    });
    const half = [width / 2 / scale, height / 2 / scale];
    const [left, top] = middle.map((m, n) => Math.floor((m.inside - half[n]) / SIDE));
    const [right, bottom] = middle.map((m, n) => Math.floor((m.inside + half[n]) / SIDE));
    const tiles = [];
    for (let y = top; y <= bottom; y++)
      for (let x = left; x <= right; x++)
        tiles.push({
          x: middle[0].index + BigInt(x), y: middle[1].index + BigInt(y),
          left: width / 2 + (x * SIDE - middle[0].inside) * scale, top: height / 2 + (y * SIDE - middle[1].inside) * scale,
          away: Math.hypot(x + 0.5 - middle[0].inside / SIDE, y + 0.5 - middle[1].inside / SIDE),
        });
    tiles.sort((a, b) => a.away - b.away);
    return { level, scale, tiles };
  }

  redraw() {
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => {
      this.pending = 0;
      this.drawNow();
    });
  }

  drawNow() {
    if (this.element.hidden || !this.started) return;
    const context = this.canvas.getContext("2d");
    this.ground ??= this.shell.photo && meanColor(this.shell.photo);
    context.fillStyle = this.ground ?? "#141414";
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    context.imageSmoothingQuality = "high";
    const { level, scale, tiles } = this.sight();
    const missing = [], coarse = new Map(); // coarse tiles that are asked first, where nothing can be shown
    for (const tile of tiles) {
      const side = SIDE * scale;
      const [x0, y0, x1, y1] = [Math.floor(tile.left), Math.floor(tile.top), Math.ceil(tile.left + side), Math.ceil(tile.top + side)];
      const own = this.tiles.get(`${level}/${tile.x}/${tile.y}`);
      if (own) {
        this.touch(`${level}/${tile.x}/${tile.y}`, own);
        if (scale === 1) context.drawImage(own, Math.round(tile.left), Math.round(tile.top));
        else context.drawImage(own, x0, y0, x1 - x0, y1 - y0);
      } else {
        missing.push(tile);
        if (!this.drawInstead(context, level, tile, x0, y0, x1 - x0, y1 - y0) && level) {
          const shift = BigInt(Math.min(level, COARSER));
          const place = [level - Number(shift), String(tile.x >> shift), String(tile.y >> shift)];
          coarse.set(place.join("/"), place);
        }
      }
    }
    const wanted = [...coarse.values(), ...missing.map((tile) => [level, String(tile.x), String(tile.y)])];
    const asked = wanted.join(" ");
    if (asked !== this.asked) {
      this.asked = asked;
      this.shell.ask("zoom", { do: "tiles", tiles: wanted.slice(0, 256) });
    }
    this.empty.hidden = tiles.length > coarse.size && this.tiles.size > 0;
    this.shell.progress(tiles.length - missing.length, tiles.length, "Synthesizing the plane");
    this.element.dataset.missing = String(missing.length);
    this.where.textContent = `${this.zoom.toFixed(2)} octaves`;
    const [column, row] = [this.x, this.y].map((at) => at >> (BITS - BigInt(level)));
    this.shell.place(`level ${level}  ${column}, ${row}`);
  }

  /** Draw a tile from a coarser level, enlarged with sharp pixels, or from finer ones; false if there are none. */
  drawInstead(context, level, tile, x, y, width, height) {
    for (let up = 1; up <= level; up++) {
      const shift = BigInt(up);
      const [px, py] = [tile.x >> shift, tile.y >> shift];
      const coarser = this.tiles.get(`${level - up}/${px}/${py}`);
      if (!coarser) continue;
      const part = SIDE / 2 ** up;
      const [sx, sy] = [Number(tile.x - (px << shift)) * part, Number(tile.y - (py << shift)) * part];
      context.imageSmoothingEnabled = false;
      context.drawImage(coarser, sx, sy, part, part, x, y, width, height);
      context.imageSmoothingEnabled = true;
      return true;
    }
    let drawn = false;
    for (let down = 1; down <= 2; down++) {
      const [shift, count] = [BigInt(down), 2 ** down];
      for (let n = 0; n < count * count; n++) {
        const [i, j] = [n % count, Math.floor(n / count)];
        const finer = this.tiles.get(`${level + down}/${(tile.x << shift) + BigInt(i)}/${(tile.y << shift) + BigInt(j)}`);
        if (!finer) continue;
        drawn = true;
        context.drawImage(finer, x + (i * width) / count, y + (j * height) / count, width / count, height / count);
      }
    }
    return drawn;
  }

  touch(key, tile) {
    this.tiles.delete(key);
    this.tiles.set(key, tile);
  }

  frame(facts, bytes) {
    const tile = canvasOf(facts, bytes);
    this.touch(`${facts.level}/${facts.x}/${facts.y}`, tile);
    this.ground = meanColor(tile); // where nothing is known yet; before, that of the photo
    while (this.tiles.size > KEPT) this.tiles.delete(this.tiles.keys().next().value);
    this.redraw();
  }

  hear(message) {
    if (message.do !== "stale") return;
    this.tiles.clear();
    this.asked = "";
    this.redraw();
  }

  askLine() {
    this.tellPlace();
    this.shell.ask("zoom", { do: "line", width: this.canvas.width, height: this.canvas.height });
  }

  addKey() {
    this.tellPlace();
    const key = { x: String(this.x), y: String(this.y), zoom: this.zoom };
    this.set({ keys: [...this.shell.state.zoom.keys, key] });
  }

  // --- input ---

  listen() {
    const { canvas } = this;
    const ratio = () => canvas.width / Math.max(1, this.view.clientWidth);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const box = canvas.getBoundingClientRect();
      this.zoomAt((event.clientX - box.left) * ratio(), (event.clientY - box.top) * ratio(), -event.deltaY * 0.0025);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.from = [event.clientX, event.clientY];
      canvas.focus();
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!this.from) return;
      this.move((this.from[0] - event.clientX) * ratio(), (this.from[1] - event.clientY) * ratio());
      this.from = [event.clientX, event.clientY];
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { this.from = null; });
  }

  key(key, event) {
    const far = event.shiftKey ? 400 : 80;
    if (key === "f") this.home();
    else if (key === "k") this.addKey();
    else if (key === "p") this.shell.ask("zoom", { do: "path" });
    else if (key === "PageDown") this.fly(1);
    else if (key === "PageUp") this.fly(-1);
    else if (key === "ArrowLeft") this.move(-far, 0);
    else if (key === "ArrowRight") this.move(far, 0);
    else if (key === "ArrowUp") this.move(0, -far);
    else if (key === "ArrowDown") this.move(0, far);
    else return false;
    return true;
  }
}
