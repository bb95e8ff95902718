// SPDX-License-Identifier: Apache-2.0
// A sample of a plane of Wang tiles, filtered like any texture. WGSL.
//
// atlas     side x side tiles; with MIP levels
// filtered  sampler of the atlas; address mode: repeat; anisotropic if you like
// plane     image of tile indices, in a format such as rgba8unorm
// side      4 for 16 tiles
// uv        in tiles, v downwards: the first row of an image is at v = 0
fn sample_wang(atlas: texture_2d<f32>, filtered: sampler, plane: texture_2d<f32>, side: f32, uv: vec2f) -> vec4f {
    // uv is continuous; the place in the atlas is not, and the GPU would take its jumps for a small texture
    let dx = dpdx(uv) / side;
    let dy = dpdy(uv) / side;
    let cell = floor(uv);
    let at = vec2i(cell) & (vec2i(textureDimensions(plane)) - 1); // sides are powers of two
    let tile = floor(textureLoad(plane, at, 0).rg * 255.0 + 0.5);
    return textureSampleGrad(atlas, filtered, (tile + uv - cell) / side, dx, dy);
}
