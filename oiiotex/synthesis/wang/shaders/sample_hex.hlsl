// SPDX-License-Identifier: Apache-2.0
// A sample of a plane of hexagons without a period, with the histogram of its tile. HLSL, shader model 4 or newer.
//
// gaussian  Gaussian values of the tile; with MIP levels
// filtered  sampler of `gaussian`; address mode: wrap; anisotropic if you like
// table     their meaning: 32 knots, a row for each component; raw values without a color space; no MIP levels
// uv        in tiles, v downwards: the first row of an image is at v = 0
//
// If your engine puts the last row of an image at v = 0, as Unity does, define HEX_FLIPPED: v then runs upwards.
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

float3 sample_hex(Texture2D gaussian, SamplerState filtered, Texture2D table, float2 uv)
{
    float2 dx = ddx(uv), dy = ddy(uv); // the places jump from hexagon to hexagon
#ifdef HEX_FLIPPED
    uv.y = -uv.y;
#endif
    float2 skewed = 3.46410162 * float2(uv.x - 0.577350269 * uv.y, 1.15470054 * uv.y);
    float2 base = floor(skewed), inside = skewed - base;
    float total = inside.x + inside.y;
    bool upper = total > 1.0;
    float3 weights = float3(abs(1.0 - total), upper ? 1.0 - inside.y : inside.x, upper ? 1.0 - inside.x : inside.y);
    weights *= weights * weights * weights * weights * weights * weights;
    int2 names[3] = {int2(base) + (upper ? 1 : 0), int2(base) + int2(1, 0), int2(base) + int2(0, 1)};
    float3 sums = 0.0;
    [unroll] for (int n = 0; n < 3; n++)
    {
        float2 center = float2(names[n].x + 0.5 * names[n].y, 0.866025404 * names[n].y) / 3.46410162;
        float2 place = uv - center + float2(hex_noise(names[n].x, names[n].y), hex_noise(names[n].x, names[n].y + 4096));
#ifdef HEX_FLIPPED
        place.y = -place.y;
#endif
        sums += weights[n] * (gaussian.SampleGrad(filtered, place, dx, dy).rgb - 0.5);
    }
    float3 at = 31.0 * saturate(0.5 + sums / sqrt(dot(weights, weights)));
    int3 knot = int3(min(floor(at), 30.0));
    uint width, height;
    table.GetDimensions(width, height);
    float3 color = 0.0;
    for (uint n = 0; n < height; n++)
    {
#ifdef HEX_FLIPPED
        int row = int(height - 1 - n);
#else
        int row = int(n);
#endif
        float3 low = table.Load(int3(knot[n], row, 0)).rgb, high = table.Load(int3(knot[n] + 1, row, 0)).rgb;
        color += lerp(low, high, at[n] - knot[n]);
    }
    return color;
}
