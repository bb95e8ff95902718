// SPDX-License-Identifier: Apache-2.0
// A sample of a plane of hexagons without a period, with the histogram of its tile. WGSL.
//
// gaussian  Gaussian values of the tile; with MIP levels
// filtered  sampler of `gaussian`; address mode: repeat; anisotropic if you like
// table     their meaning: 32 knots, a row for each component; raw values without a color space; no MIP levels
// uv        in tiles, v downwards: the first row of an image is at v = 0
fn hex_noise(x: i32, y: i32) -> f32 {
    var a = 0xdeadbeefu + 21u;
    var b = a + bitcast<u32>(y);
    var c = a;
    a += bitcast<u32>(x);
    c ^= b; c -= (b << 14u) | (b >> 18u);
    a ^= c; a -= (c << 11u) | (c >> 21u);
    b ^= a; b -= (a << 25u) | (a >> 7u);
    c ^= b; c -= (b << 16u) | (b >> 16u);
    a ^= c; a -= (c << 4u) | (c >> 28u);
    b ^= a; b -= (a << 14u) | (a >> 18u);
    c ^= b; c -= (b << 24u) | (b >> 8u);
    return f32(c) / 4294967295.0;
}

fn sample_hex(gaussian: texture_2d<f32>, filtered: sampler, table: texture_2d<f32>, uv: vec2f) -> vec3f {
    let dx = dpdx(uv); // the places jump from hexagon to hexagon
    let dy = dpdy(uv);
    let skewed = 3.46410162 * vec2f(uv.x - 0.577350269 * uv.y, 1.15470054 * uv.y);
    let base = floor(skewed);
    let inside = skewed - base;
    let total = inside.x + inside.y;
    let upper = total > 1.0;
    var weights = vec3f(abs(1.0 - total), select(inside.x, 1.0 - inside.y, upper), select(inside.y, 1.0 - inside.x, upper));
    weights *= weights * weights * weights * weights * weights * weights;
    let corner = vec2i(base);
    var names = array<vec2i, 3>(corner + select(0, 1, upper), corner + vec2i(1, 0), corner + vec2i(0, 1));
    var sums = vec3f(0.0);
    for (var n = 0; n < 3; n++) {
        let name = names[n];
        let center = vec2f(f32(name.x) + 0.5 * f32(name.y), 0.866025404 * f32(name.y)) / 3.46410162;
        let place = uv - center + vec2f(hex_noise(name.x, name.y), hex_noise(name.x, name.y + 4096));
        sums += weights[n] * (textureSampleGrad(gaussian, filtered, place, dx, dy).rgb - 0.5);
    }
    let at = 31.0 * clamp(0.5 + sums / sqrt(dot(weights, weights)), vec3f(0.0), vec3f(1.0));
    let knot = vec3i(min(floor(at), vec3f(30.0)));
    var color = vec3f(0.0);
    for (var n = 0; n < i32(textureDimensions(table).y); n++) {
        let low = textureLoad(table, vec2i(knot[n], n), 0).rgb;
        let high = textureLoad(table, vec2i(knot[n] + 1, n), 0).rgb;
        color += mix(low, high, at[n] - f32(knot[n]));
    }
    return color;
}
