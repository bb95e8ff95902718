// SPDX-License-Identifier: Apache-2.0
// Looking closely: values under the pointer, a histogram, and measures in false color. The server computes them.

import { make } from "./controls.js";

const PATIENCE = 500; // ms until a sample that was not answered is asked again
const RAMP = [[0, 0, 4], [87, 16, 110], [188, 55, 84], [249, 142, 9], [252, 255, 164]]; // dark to bright
const MEASURES = { drift: ["Drift", "Deviation of local statistics from those of the rest, in Lab units (--texstationarity)"], repetition: ["Repetition", "Number of uses of the 32 px region of the photo around a pixel"] };

export class Inspect {
  constructor(room) {
    this.room = room;
    this.maps = { photo: null, tile: null }; // {name, high, plane, width, height, canvas}
    this.name = ""; // of the measure that is shown
    this.asked = 0; // time of the sample that is not answered yet
    this.canvas = make("canvas", { width: 300, height: 140, role: "img", className: "histogram", ariaLabel: "Histogram of the tile, filled, and of the photo, as a line, as they are displayed" });
    this.legend = make("p", { className: "hint", hidden: true });
    this.element = make("div", { className: "inspect" }, this.canvas, this.legend);
  }

  // --- false color ---

  /** Show a measure ("drift", "repetition") instead of the colors, or the colors (""). */
  show(name) {
    this.name = MEASURES[name] ? name : "";
    this.legend.hidden = !this.name;
    if (this.name) this.ask();
  }

  /** Ask for the maps of the measure that is shown. */
  ask() {
    if (!this.name) return;
    this.maps = { photo: null, tile: null };
    this.legend.title = MEASURES[this.name][1];
    this.legend.textContent = `${MEASURES[this.name][0]} ...`;
    this.room.shell.ask("tile", { do: "measure", name: this.name });
  }

  take({ name, what, width, height, high }, plane) {
    const canvas = make("canvas", { width, height });
    const image = new ImageData(width, height);
    const out = new Uint32Array(image.data.buffer);
    const colors = Uint32Array.from({ length: 256 }, (_, n) => ramp(n / 255));
    for (let n = 0; n < out.length; n++) out[n] = colors[plane[n]];
    canvas.getContext("2d").putImageData(image, 0, 0);
    this.maps[what] = { name, high, plane, width, height, canvas };
    if (name === this.name) this.legend.replaceChildren(`${MEASURES[name][0]} 0 `, make("span", { className: "ramp" }), ` ${Number(high.toPrecision(3))}`);
  }

  /** What the views draw for the photo or the tile: the measure, or the image. */
  picture(what, canvas) {
    const map = this.maps[what];
    return this.name && map?.name === this.name ? map.canvas : canvas;
  }

  // --- values ---

  /** Tell the values of a pixel of the file. */
  sample(what, x, y) {
    this.wanted = null;
    const [width, height] = what === "photo" ? this.room.shell.facts.photo : this.room.compare.shown().size;
    const times = what === "photo" || this.room.mode === "1x1" ? 1 : 2;
    if (x === null || x < 0 || y < 0 || x >= times * width || y >= times * height) return this.room.shell.place("");
    const place = { what, x: x % width, y: y % height };
    const own = what === "photo" || (this.room.compare.shown().canvas === this.room.tile && this.room.whole);
    if (!own) return this.tell({ ...place, values: [], shown: this.displayed(place, width, height) });
    if (performance.now() - this.asked < PATIENCE) this.wanted = place;
    else this.askFor(place);
  }

  askFor(place) {
    this.asked = performance.now();
    this.room.shell.ask("tile", { do: "sample", ...place });
  }

  /** Values that the page shows of a stored or coarse tile, whose file does not exist. */
  displayed({ x, y }, width, height) {
    const { canvas } = this.room.compare.shown();
    const place = [Math.floor((x * canvas.width) / width), Math.floor((y * canvas.height) / height)];
    return [...canvas.getContext("2d").getImageData(...place, 1, 1).data].slice(0, 3);
  }

  hear(message) {
    this.asked = 0;
    if (message.shown.length) this.tell(message);
    if (this.wanted) this.askFor(this.wanted);
    this.wanted = null;
  }

  tell({ what, x, y, values, shown }) {
    const file = values.map(([name, value]) => `${name} ${value}`).join("  ");
    const map = this.maps[what];
    const measure = this.name && map?.name === this.name ? `  ${this.name} ${this.measured(map, what, x, y)}` : "";
    this.room.shell.place(`${what === "photo" ? "Photo" : "Tile"} ${x}, ${y}:  ${file}  display ${shown.join(" ")}${measure}`);
  }

  measured(map, what, x, y) {
    const [width, height] = what === "photo" ? this.room.shell.facts.photo : this.room.size;
    const at = Math.floor((y * map.height) / height) * map.width + Math.floor((x * map.width) / width);
    return Number(((map.plane[at] / 255) * map.high).toPrecision(3));
  }

  // --- histogram ---

  /** Draw the histogram of the tile that is shown, and the photo's. */
  draw() {
    const { width, height } = this.canvas;
    const context = this.canvas.getContext("2d");
    const line = (counts, n) => counts.forEach((count, bin) => context.lineTo(((bin + 0.5) * width) / counts.length, height - Math.sqrt(count[n] / 1000) * (height - 4)));
    const turned = (channels) => channels[0].map((_, bin) => channels.map((one) => one[bin]));
    context.clearRect(0, 0, width, height);
    const tile = this.room.compare.shown().canvas?.histogram;
    context.globalCompositeOperation = "screen";
    for (const [n, color] of ["#b04848", "#4c9a52", "#4a6cc4"].entries()) {
      if (!tile) break;
      context.beginPath();
      context.moveTo(0, height);
      line(turned(tile), n);
      context.lineTo(width, height);
      context.fillStyle = color;
      context.fill();
    }
    context.globalCompositeOperation = "source-over";
    const photo = this.room.photo?.histogram;
    if (!photo) return;
    context.beginPath();
    line(turned(photo).map((counts) => [Math.max(...counts)]), 0);
    context.strokeStyle = "#c9c9c9";
    context.stroke();
  }
}

/** A color of the ramp, 0 to 1, as a little-endian pixel. */
function ramp(value) {
  const at = value * (RAMP.length - 1);
  const n = Math.min(RAMP.length - 2, Math.floor(at));
  const [red, green, blue] = RAMP[n].map((low, channel) => Math.round(low + (at - n) * (RAMP[n + 1][channel] - low)));
  return (0xff000000 | red | (green << 8) | (blue << 16)) >>> 0;
}
