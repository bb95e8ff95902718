// SPDX-License-Identifier: Apache-2.0
// Filtered values of a tile that is stored as its photo and an index, by textures of textures.py. GLSL 3.30 and ES 3.00.
//
//   in vec2 uv;  // in tiles: (0, 0) is the top left corner of one, and the tile repeats
//   uniform usampler2D index;
//   uniform sampler2DArray color, height;
//   IndexedTexels texels = indexed_texels(index, textureSize(color, 0), uv, indexed_lod(index, uv));
//   vec3 rgb = indexed_value(color, texels).rgb;
//   float h = indexed_value(height, texels).r;
//
// index: R32UI with all MIP levels. Without bit 31, an entry is rows << 16 | columns from the texel's first pixel in the
// tile to its source in the photo. With bit 31, the rest is the number of a texel in the map, counted through its layers.
// map: an array of layers of the photo's size: the photo, the photo filtered for some levels, and texels at seams.
// Both are fetched without filters; all filtering is done here: bilinear between texels and linear between levels.

#ifdef GL_ES
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp sampler2DArray;
#endif

struct IndexedTexels {
    ivec3 at[8];  // column, row and layer in each map: four of the finer level, then four of the coarser one
    float weight[8];
    int count;  // 4 if one level is enough
};

// Level of detail at a pixel, as for a texture of the tile's size.
float indexed_lod(usampler2D index, vec2 uv)
{
    vec2 size = vec2(textureSize(index, 0));
    vec2 across = dFdx(uv) * size, down = dFdy(uv) * size;
    return 0.5 * log2(max(max(dot(across, across), dot(down, down)), 1e-12));
}

// Where a map has the texel of a level; it is at most one tile outside of the tile.
ivec3 indexed_at(usampler2D index, ivec3 map_size, ivec2 texel, int level)
{
    ivec2 tile = textureSize(index, level);
    texel = (texel + tile) % tile;
    uint entry = texelFetch(index, texel, level).r;
    if ((entry >> 31) == 0u) {
        ivec2 offset = ivec2(entry & 0xFFFFu, entry >> 16);
        return ivec3(((texel << level) + offset) % map_size.xy, level);
    }
    int number = int(entry & 0x7FFFFFFFu);
    int row = number / map_size.x;
    return ivec3(number % map_size.x, row % map_size.y, row / map_size.y);
}

// The four texels around a place and their bilinear weights, as the first or second half of `texels`.
void indexed_bilinear(usampler2D index, ivec3 map_size, vec2 uv, int level, float share, int first, inout IndexedTexels texels)
{
    vec2 place = fract(uv) * vec2(textureSize(index, level)) - 0.5;
    ivec2 corner = ivec2(floor(place));
    vec2 right = place - vec2(corner), left = 1.0 - right;
    texels.at[first] = indexed_at(index, map_size, corner, level);
    texels.at[first + 1] = indexed_at(index, map_size, corner + ivec2(1, 0), level);
    texels.at[first + 2] = indexed_at(index, map_size, corner + ivec2(0, 1), level);
    texels.at[first + 3] = indexed_at(index, map_size, corner + ivec2(1, 1), level);
    texels.weight[first] = share * left.x * left.y;
    texels.weight[first + 1] = share * right.x * left.y;
    texels.weight[first + 2] = share * left.x * right.y;
    texels.weight[first + 3] = share * right.x * right.y;
}

// The texels of all maps of one size at a place, at a level of detail: four index fetches for each level.
IndexedTexels indexed_texels(usampler2D index, ivec3 map_size, vec2 uv, float lod)
{
    ivec2 tile = textureSize(index, 0);
    int last = (floatBitsToInt(float(max(tile.x, tile.y))) >> 23) - 127;  // floor of the logarithm, exactly
    lod = clamp(lod, 0.0, float(last));
    int level = int(lod);
    float coarser = lod - float(level);
    IndexedTexels texels;
    texels.count = coarser > 0.0 ? 8 : 4;
    indexed_bilinear(index, map_size, uv, level, 1.0 - coarser, 0, texels);
    if (coarser > 0.0)
        indexed_bilinear(index, map_size, uv, level + 1, coarser, 4, texels);
    return texels;
}

// The value of a map: four texel fetches for each level.
vec4 indexed_value(sampler2DArray map, IndexedTexels texels)
{
    vec4 sum = vec4(0.0);
    for (int n = 0; n < texels.count; ++n)
        sum += texels.weight[n] * texelFetch(map, texels.at[n], 0);
    return sum;
}
