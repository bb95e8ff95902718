// Images are rows of interleaved values, CHANNELS to a pixel.
#ifndef CHANNELS
#define CHANNELS 3
#endif

// Indices into a buffer, in 64 bits: sizes along an axis fit an int, their products do not.
#define AT(y, x, width) ((size_t)(y) * (size_t)(width) + (size_t)(x))

// Wraps a coordinate that is less than n beyond the border of a torus of size n.
#define WRAPPED(i, n) ((i) < 0 ? (i) + (n) : (i) >= (n) ? (i) - (n) : (i))

// A pixel of an exemplar as one number, as in core/source_map.py; an offset can be added to it.
static inline uint corner(int y, int x) { return (uint)y << 16 | (uint)x; }
static inline int corner_y(uint c) { return (int)(c >> 16); }
static inline int corner_x(uint c) { return (int)(c & 0xffffu); }
