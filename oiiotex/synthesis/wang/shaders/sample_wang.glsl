// SPDX-License-Identifier: Apache-2.0
// A sample of a plane of Wang tiles, filtered like any texture. GLSL 3.30, GLSL ES 3.00, Godot (see its page).
//
// atlas  side x side tiles; wrap: repeat; with MIP levels, and anisotropic if you like
// plane  image of tile indices; wrap: repeat; raw values without a color space; no MIP levels are read
// side   4 for 16 tiles
// uv     in tiles, v downwards: the first row of an image is at v = 0
//
// If your loader puts the last row of an image at v = 0, define WANG_FLIPPED: v then runs upwards.
vec4 sample_wang(sampler2D atlas, sampler2D plane, float side, vec2 uv)
{
    // uv is continuous; the place in the atlas is not, and the GPU would take its jumps for a small texture
    vec2 dx = dFdx(uv) / side, dy = dFdy(uv) / side;
#ifdef WANG_FLIPPED
    uv.y = -uv.y;
#endif
    vec2 cell = floor(uv);
    vec2 where = (cell + 0.5) / vec2(textureSize(plane, 0));
#ifdef WANG_FLIPPED
    where.y = -where.y;
#endif
    vec2 tile = floor(textureLod(plane, where, 0.0).rg * 255.0 + 0.5);
    vec2 place = (tile + uv - cell) / side;
#ifdef WANG_FLIPPED
    place.y = -place.y;
#endif
    return textureGrad(atlas, place, dx, dy);
}
