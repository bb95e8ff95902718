// SPDX-License-Identifier: Apache-2.0
// The maps of a material: next to each other, and lit on a plane. Shading, lights and sky are those of the previews of
// a library (LitMaterial.seen in charts/lighting.py); heights displace the plane (relief mapping by a linear search).

import { make } from "./controls.js";
import { canvasOf } from "./wire.js";

const PLAIN = { color: [128, 128, 128], normal: [128, 128, 255], roughness: [178, 178, 178], height: [255, 255, 255], ao: [255, 255, 255], metal: [0, 0, 0] };
const DEPTH = 0.05; // of the heights, in tiles
const TURN = 0.1; // of an arrow key: the light's place in the view
const VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
const FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D color, normal, roughness, height, ao, metal;
uniform vec2 view, tile, light; // px of the canvas; sides of a tile, the longer is 1; place of the key light, -1 to 1
uniform float depth, hand, bumps, gain; // hand: 1, or -1 for DirectX; bumps: normals come from heights
out vec4 seen;
const float PI = 3.14159265, SKY = 0.7, GROUND = 0.25;
float smith(float n, float a) { return 2.0 * n / max(n + sqrt(a * a + (1.0 - a * a) * n * n), 1e-6); }
vec3 encoded(vec3 c) { return mix(1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, 12.92 * c, lessThanEqual(c, vec3(0.0031308))); }
vec3 lit(vec3 n, vec3 v, vec3 towards, float strength, vec3 base, float m, float a) {
  vec3 l = normalize(towards), h = normalize(l + v), f0 = mix(vec3(0.04), base, m);
  float nl = max(dot(n, l), 0.0), nv = max(dot(n, v), 1e-3), nh = max(dot(n, h), 0.0), d = nh * nh * (a * a - 1.0) + 1.0;
  vec3 f = f0 + (1.0 - f0) * pow(1.0 - dot(h, v), 5.0);
  vec3 glance = f * (a * a / max(PI * d * d, 1e-9)) * smith(nl, a) * smith(nv, a) / max(4.0 * nl * nv, 1e-4);
  return strength * nl * (base * (1.0 - m) * (1.0 - f) / PI + glance);
}
void main() {
  vec2 at = (gl_FragCoord.xy * 2.0 - view) / view.y;
  vec3 eye = vec3(0.0, -1.5, 1.9), ahead = normalize(-eye), right = vec3(1.0, 0.0, 0.0), up = cross(right, ahead);
  vec3 ray = normalize(ahead + 0.55 * (at.x * right + at.y * up));
  vec3 top = eye - ray * (eye.z / ray.z);
  vec2 step = ray.xy / -ray.z * depth / 48.0 / tile * vec2(1.0, -1.0);
  vec2 uv = top.xy / tile * vec2(1.0, -1.0) + 0.5, dx = dFdx(uv), dy = dFdy(uv);
  float low = 0.0, before = 0.0;
  for (int n = 0; n < 48; n++) {
    float gap = 1.0 - textureGrad(height, uv, dx, dy).r - low;
    if (gap <= 0.0) { uv -= step * (gap / min(gap - before, -1e-6)); break; }
    before = gap; low += 1.0 / 48.0; uv += step;
  }
  vec3 n = textureGrad(normal, uv, dx, dy).rgb * 2.0 - 1.0;
  n.y *= hand;
  if (bumps > 0.0) {
    vec2 px = 1.0 / vec2(textureSize(height, 0));
    vec2 slope = vec2(textureGrad(height, uv + vec2(px.x, 0.0), dx, dy).r - textureGrad(height, uv - vec2(px.x, 0.0), dx, dy).r,
      textureGrad(height, uv - vec2(0.0, px.y), dx, dy).r - textureGrad(height, uv + vec2(0.0, px.y), dx, dy).r);
    n = vec3(-slope * depth / (2.0 * px * tile), 1.0);
  }
  n = normalize(n);
  float r = textureGrad(roughness, uv, dx, dy).r, m = textureGrad(metal, uv, dx, dy).r, a = pow(max(r, 0.05), 2.0);
  vec3 base = textureGrad(color, uv, dx, dy).rgb, gloss = 0.04 * (1.0 - m) * (1.0 - r) + base * m;
  vec3 sum = mix(GROUND, SKY, 0.5 + 0.5 * n.y) * textureGrad(ao, uv, dx, dy).r * (base * (1.0 - m) + gloss);
  sum += lit(n, -ray, vec3(light, 0.55), 3.6, base, m, a) + lit(n, -ray, vec3(0.8, 0.15, 0.35), 0.8, base, m, a);
  seen = vec4(encoded(clamp(gain * sum, 0.0, 1.0)), 1.0);
}`;

export class Lit {
  /** `room`: the Tile room, whose tile is the color. */
  constructor(room) {
    this.room = room;
    this.maps = new Map(); // { canvas, hand } by role
    this.light = [-0.55, 0.65];
    this.lit = make("canvas", { role: "img", ariaLabel: "Material lit on a plane", tabIndex: 0, hidden: true, title: "Move the pointer, or use the arrows, to move the light" });
    this.flat = make("canvas", { role: "img", ariaLabel: "Maps of the material", hidden: true });
    this.lit.addEventListener("pointermove", (event) => {
      const box = this.lit.getBoundingClientRect();
      this.move((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
    });
    this.lit.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, TURN], ArrowDown: [0, -TURN] }[event.key];
      if (!by) return;
      event.preventDefault();
      this.move(this.light[0] + by[0], this.light[1] + by[1]);
    });
    room.tileView.element.append(this.lit, this.flat);
    new ResizeObserver(() => this.draw()).observe(room.tileView.element);
  }

  move(x, y) {
    this.light = [x, y].map((n) => Math.min(1, Math.max(-1, n)));
    this.draw();
  }

  take(facts, bytes) {
    if (facts.role === "color") {
      this.base = canvasOf(facts, bytes); // in sRGB, whatever the view
      this.given = facts.given; // the photo's own maps, shown until a tile is finished
      [this.color, this.size] = facts.given ? [this.room.photo ?? this.base, this.room.shell.facts.photo] : [this.room.tile, this.room.size]; // of the same tile: coarse ones that follow have no maps yet
    } else this.maps.set(facts.role, { canvas: canvasOf(facts, bytes), hand: facts.hand });
    this.stale = true;
    this.draw();
  }

  /** Show one of the views, "lit" or "maps", or neither. */
  show(mode) {
    this.lit.hidden = mode !== "lit";
    this.flat.hidden = mode !== "maps";
    this.stale = true;
    this.draw();
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.room.tileView.element;
    if (!this.color || !width) return;
    const canvas = !this.lit.hidden ? this.lit : !this.flat.hidden ? this.flat : null;
    if (!canvas) return;
    [canvas.width, canvas.height] = [width, height];
    if (canvas === this.lit) this.drawLit();
    else this.drawMaps();
  }

  /** All maps in a grid, the color first. */
  drawMaps() {
    const context = this.flat.getContext("2d");
    const top = this.room.tileView.bar.offsetHeight + 12; // the buttons hide nothing
    const width = this.flat.width, height = this.flat.height - top;
    const all = [["color", this.color], ...[...this.maps].map(([role, { canvas }]) => [role, canvas])];
    const across = Math.ceil(Math.sqrt(all.length)), down = Math.ceil(all.length / across);
    const [wide, high] = [width / across, height / down];
    context.fillStyle = "#141414";
    context.fillRect(0, 0, width, top + height);
    context.font = "12px system-ui, sans-serif";
    all.forEach(([role, canvas], n) => {
      const scale = Math.min((wide - 12) / canvas.width, (high - 30) / canvas.height);
      const [w, h] = [canvas.width * scale, canvas.height * scale];
      const [x, y] = [(n % across) * wide + (wide - w) / 2, top + Math.floor(n / across) * high + 24 + (high - 30 - h) / 2];
      context.drawImage(canvas, x, y, w, h);
      context.fillStyle = "#c9c9c9";
      context.fillText(role, x, y - 5);
    });
  }

  drawLit() {
    this.gl ??= this.opened();
    if (!this.gl) return this.room.shell.status("This browser has no WebGL 2, so Lit cannot be shown. Choose Maps", true);
    const { gl, program } = this;
    if (this.stale) this.fill();
    this.stale = false;
    const set = (name, ...values) => gl[`uniform${values.length}f`](gl.getUniformLocation(program, name), ...values);
    gl.viewport(0, 0, this.lit.width, this.lit.height);
    set("view", this.lit.width, this.lit.height);
    set("tile", ...this.size.map((n) => n / Math.max(...this.size)));
    set("light", ...this.light);
    set("gain", 2 ** this.room.shell.state.view.exposure);
    set("depth", this.maps.has("height") ? DEPTH : 0);
    set("hand", this.maps.get("normal")?.hand === "directx" ? -1 : 1);
    set("bumps", this.maps.has("height") && !this.maps.has("normal") ? 1 : 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  opened() {
    const gl = this.lit.getContext("webgl2", { preserveDrawingBuffer: true });
    if (!gl) return null;
    this.program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    gl.useProgram(this.program);
    this.textures = Object.keys(PLAIN).map((name, n) => {
      gl.uniform1i(gl.getUniformLocation(this.program, name), n);
      return gl.createTexture();
    });
    this.stale = true;
    return gl;
  }

  /** Fill the textures: the tile, the maps, and plain colors for missing maps. */
  fill() {
    const { gl } = this;
    Object.entries(PLAIN).forEach(([name, plain], n) => {
      const picture = name === "color" ? this.base : this.maps.get(name)?.canvas ?? (name === "roughness" ? this.inverted("gloss") : null);
      gl.activeTexture(gl.TEXTURE0 + n);
      gl.bindTexture(gl.TEXTURE_2D, this.textures[n]);
      const format = name === "color" ? gl.SRGB8_ALPHA8 : gl.RGBA;
      if (picture) gl.texImage2D(gl.TEXTURE_2D, 0, format, gl.RGBA, gl.UNSIGNED_BYTE, picture);
      else gl.texImage2D(gl.TEXTURE_2D, 0, format, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([...plain, 255]));
      gl.generateMipmap(gl.TEXTURE_2D);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    });
  }

  /** The inverse of a map, or null. */
  inverted(role) {
    const { canvas } = this.maps.get(role) ?? {};
    if (!canvas) return null;
    const copy = make("canvas", { width: canvas.width, height: canvas.height });
    const context = copy.getContext("2d");
    context.filter = "invert(1)";
    context.drawImage(canvas, 0, 0);
    return copy;
  }
}
