// e^x for x <= 0 with a relative error of 2e-7, only by + and *, which all devices round alike; 0 below e^-80.
// Include it with FP_CONTRACT off.
static inline float exponential(float x) {
  if (x < -80.0f) return 0.0f;
  int octave = (int)(x * 1.44269504f - 0.5f);
  float rest = (x - (float)octave * 0.693359375f) - (float)octave * -2.12194440e-4f;
  float value = 1.38888889e-3f;
  value = value * rest + 8.33333333e-3f;
  value = value * rest + 4.16666667e-2f;
  value = value * rest + 1.66666667e-1f;
  value = value * rest + 0.5f;
  value = value * rest + 1.0f;
  value = value * rest + 1.0f;
  return as_float((octave + 127) << 23) * value;
}
