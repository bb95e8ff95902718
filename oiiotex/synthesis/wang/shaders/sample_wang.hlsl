// SPDX-License-Identifier: Apache-2.0
// A sample of a plane of Wang tiles, filtered like any texture. HLSL, shader model 4 or newer.
//
// atlas     side x side tiles; with MIP levels
// filtered  sampler of the atlas; address mode: wrap; anisotropic if you like
// plane     image of tile indices, raw values without a color space
// side      4 for 16 tiles
// uv        in tiles, v downwards: the first row of an image is at v = 0
//
// If your engine puts the last row of an image at v = 0, as Unity does, define WANG_FLIPPED: v then runs upwards.
float4 sample_wang(Texture2D atlas, SamplerState filtered, Texture2D plane, float side, float2 uv)
{
    // uv is continuous; the place in the atlas is not, and the GPU would take its jumps for a small texture
    float2 dx = ddx(uv) / side, dy = ddy(uv) / side;
    uint width, height;
    plane.GetDimensions(width, height);
#ifdef WANG_FLIPPED
    uv.y = -uv.y;
#endif
    float2 cell = floor(uv);
    int2 at = int2(cell) & (int2(width, height) - 1); // sides are powers of two
#ifdef WANG_FLIPPED
    at.y = height - 1 - at.y;
#endif
    float2 tile = floor(plane.Load(int3(at, 0)).rg * 255.0 + 0.5);
    float2 place = (tile + uv - cell) / side;
#ifdef WANG_FLIPPED
    place.y = -place.y;
#endif
    return atlas.SampleGrad(filtered, place, dx, dy);
}
