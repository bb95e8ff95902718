// Images are rows of interleaved values, CHANNELS to a pixel.
#ifndef CHANNELS
#define CHANNELS 3
#endif

// Where things lie in a buffer, in 64 bits: sizes along an axis fit an int, their products do not.
#define AT(y, x, width) ((size_t)(y) * (size_t)(width) + (size_t)(x))

// A place on a torus of size n that is less than n beyond its border.
#define WRAPPED(i, n) ((i) < 0 ? (i) + (n) : (i) >= (n) ? (i) - (n) : (i))

// A pixel of an exemplar as one number, as core/source_map.py has it; a pixel and a step from it add up.
static inline uint corner(int y, int x) { return (uint)y << 16 | (uint)x; }
static inline int corner_y(uint c) { return (int)(c >> 16); }
static inline int corner_x(uint c) { return (int)(c & 0xffffu); }
