// SPDX-License-Identifier: Apache-2.0
// A tile repeated on a plane to the horizon, which makes repetition visible. Pixels are filtered with MIP maps.

/** The tile's MIP levels, the finest first: {width, height, data}. */
export function mipmaps(canvas) {
  const levels = [];
  let level = canvas;
  for (;;) {
    const { width, height } = level;
    levels.push({ width, height, data: new Uint32Array(level.getContext("2d").getImageData(0, 0, width, height).data.buffer) });
    if (width === 1 && height === 1) return levels;
    const half = document.createElement("canvas");
    half.width = Math.max(1, width >> 1);
    half.height = Math.max(1, height >> 1);
    const context = half.getContext("2d");
    context.imageSmoothingQuality = "high";
    context.drawImage(level, 0, 0, half.width, half.height);
    level = half;
  }
}

/** Draw the plane into a canvas. The nearest row shows `along` tiles. */
export function drawPlane(canvas, levels, along = 3) {
  const { width, height } = canvas;
  const context = canvas.getContext("2d");
  const image = context.createImageData(width, height);
  const out = new Uint32Array(image.data.buffer);
  const horizon = Math.round(height * 0.18);
  out.fill(0xff2a2726, 0, horizon * width);
  const base = levels[0];
  for (let y = horizon; y < height; y++) {
    const depth = (height - horizon) / (y - horizon + 0.5);
    const step = (along * depth) / width; // tiles to a pixel across
    const down = (along * depth * depth) / (height - horizon); // along the view
    const covered = Math.max(step * base.width, Math.sqrt(step * down) * base.height);
    const n = Math.min(levels.length - 1, Math.max(0, Math.round(Math.log2(covered))));
    const { width: w, height: h, data } = levels[n];
    const v = (((along * depth) % 1) + 1) % 1;
    const row = Math.min(h - 1, Math.floor(v * h)) * w;
    let u = 0.5 - (width / 2) * step;
    for (let x = 0, at = y * width; x < width; x++, at++, u += step) {
      const f = u - Math.floor(u);
      out[at] = data[row + Math.min(w - 1, Math.floor(f * w))];
    }
  }
  context.putImageData(image, 0, 0);
}
