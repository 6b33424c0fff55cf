// exp and log near their zeros: float32's exp(x) − 1 and log(1 + x) lose every digit there, and a driver's log is only
// accurate to an absolute 1e-7 near 1.
#ifndef ARAH_LIB_STABLE_GLSL
#define ARAH_LIB_STABLE_GLSL

// exp(x) − 1. Within ±½ the series to x⁹/9!, whose rest is below 1e-8 of the result.
float stable_expm1(float x) {
  float series = x * (1.0 + x * (1.0 / 2.0) * (1.0 + x * (1.0 / 3.0) * (1.0 + x * (1.0 / 4.0) * (1.0 + x * (1.0 / 5.0) *
                 (1.0 + x * (1.0 / 6.0) * (1.0 + x * (1.0 / 7.0) * (1.0 + x * (1.0 / 8.0) * (1.0 + x * (1.0 / 9.0)))))))));
  return abs(x) < 0.5 ? series : exp(x) - 1.0;
}

// log(1 + x), x > −1. Within ±½ 2 artanh(s), s = x / (2 + x), to s¹³/13, whose rest is below 2e-8 of the result.
float stable_log1p(float x) {
  float s = x / (2.0 + x);
  float q = s * s;
  float series = 2.0 * s * (1.0 + q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0 + q * (1.0 / 11.0 +
                 q * (1.0 / 13.0)))))));
  return abs(x) < 0.5 ? series : log(1.0 + x);
}

// 1 / (1 + exp(−x)) without overflow for either sign, exact in the tail that goes to 0.
float stable_sigmoid(float x) {
  float e = exp(-abs(x));
  return (x >= 0.0 ? 1.0 : e) / (1.0 + e);
}

// A power of two, so that nothing is rounded, after which the squares of a vector's components can be added: they underflow
// below 1e-19 and overflow above 1e19. 1, so that nothing changes, where the largest component lies between 2^-50 and 2^60.
float factor_for_squares(vec3 v) {
  const float largest = max(max(abs(v.x), abs(v.y)), abs(v.z));
  return largest < 8.8817842e-16 ? 1.23794004e27 : largest > 1.1529215e18 ? 8.4703295e-22 : 1.0;  // 2^90, 2^-70
}

#endif
