// SPDX-License-Identifier: Apache-2.0
// A sample of a plane of hexagons without a period, with the histogram of its tile. GLSL 3.30, GLSL ES 3.00, Godot.
//
// gaussian  Gaussian values of the tile; wrap: repeat; with MIP levels, and anisotropic if you like
// table     their meaning: 32 knots, a row for each component; raw values without a color space; no MIP levels
// uv        in tiles, v downwards: the first row of an image is at v = 0
//
// If your loader puts the last row of an image at v = 0, define HEX_FLIPPED: v then runs upwards.
float hex_noise(int x, int y)
{
    uint a = 0xdeadbeefu + 21u, b = a + uint(y), c = a;
    a += uint(x);
    c ^= b; c -= (b << 14) | (b >> 18);
    a ^= c; a -= (c << 11) | (c >> 21);
    b ^= a; b -= (a << 25) | (a >> 7);
    c ^= b; c -= (b << 16) | (b >> 16);
    a ^= c; a -= (c << 4) | (c >> 28);
    b ^= a; b -= (a << 14) | (a >> 18);
    c ^= b; c -= (b << 24) | (b >> 8);
    return float(c) / 4294967295.0;
}

vec3 sample_hex(sampler2D gaussian, sampler2D table, vec2 uv)
{
    vec2 dx = dFdx(uv), dy = dFdy(uv); // the places jump from hexagon to hexagon
#ifdef HEX_FLIPPED
    uv.y = -uv.y;
#endif
    vec2 skewed = 3.46410162 * vec2(uv.x - 0.577350269 * uv.y, 1.15470054 * uv.y);
    vec2 base = floor(skewed), inside = skewed - base;
    float total = inside.x + inside.y;
    bool upper = total > 1.0;
    vec3 weights = vec3(abs(1.0 - total), upper ? 1.0 - inside.y : inside.x, upper ? 1.0 - inside.x : inside.y);
    weights *= weights * weights * weights * weights * weights * weights;
    vec3 sums = vec3(0.0);
    for (int n = 0; n < 3; n++)
    {
        ivec2 name = ivec2(base) + (n == 0 ? ivec2(upper ? 1 : 0) : n == 1 ? ivec2(1, 0) : ivec2(0, 1));
        vec2 center = vec2(float(name.x) + 0.5 * float(name.y), 0.866025404 * float(name.y)) / 3.46410162;
        vec2 place = uv - center + vec2(hex_noise(name.x, name.y), hex_noise(name.x, name.y + 4096));
#ifdef HEX_FLIPPED
        place.y = -place.y;
#endif
        sums += weights[n] * (textureGrad(gaussian, place, dx, dy).rgb - 0.5);
    }
    vec3 at = 31.0 * clamp(0.5 + sums / sqrt(dot(weights, weights)), 0.0, 1.0);
    ivec3 knot = ivec3(min(floor(at), 30.0));
    vec3 color = vec3(0.0);
    for (int n = 0; n < textureSize(table, 0).y; n++)
    {
#ifdef HEX_FLIPPED
        int row = textureSize(table, 0).y - 1 - n;
#else
        int row = n;
#endif
        vec3 low = texelFetch(table, ivec2(knot[n], row), 0).rgb, high = texelFetch(table, ivec2(knot[n] + 1, row), 0).rgb;
        color += mix(low, high, at[n] - float(knot[n]));
    }
    return color;
}
