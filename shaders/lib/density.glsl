// Density of a sample: the float32 twin of kernels/reference/density.h. Laplace, of a signed distance (ARAH.md section 6):
//   outside (s > 0): σ = exp(−s/b) / 2b,   inside: σ = 1/b − exp(s/b) / 2b.
#ifndef ARAH_LIB_DENSITY_GLSL
#define ARAH_LIB_DENSITY_GLSL
#include "lib/finite.glsl"
#include "lib/stable.glsl"
#include "shared/compositing.h"

// b of its free parameter, metres.
float laplace_scale(float parameter) { return clamped(abs(parameter), 1e-6, 1e6); }

// db/dparameter: 0 beyond the bounds.
float laplace_scale_derivative(float parameter) {
  float size = abs(parameter);
  return size >= 1e-6 && size <= 1e6 ? (parameter < 0.0 ? -1.0 : 1.0) : 0.0;
}

struct Density {
  float value;  // 1/m
  float d_sdf;
  float d_b;
};

Density laplace_density(float sdf, float b) {
  float inverse = 1.0 / b;
  float u = abs(sdf) * inverse;
  float tail = 0.5 * exp(-u) * inverse;
  // An underflowed tail times an infinite u would be NaN.
  float d_tail = tail > 0.0 ? tail * (u - 1.0) * inverse : 0.0;
  Density density;
  density.value = sdf > 0.0 ? tail : inverse - tail;
  density.d_sdf = sdf == 0.0 ? 0.0 : -tail * inverse;
  density.d_b = sdf > 0.0 ? d_tail : -inverse * inverse - d_tail;
  return density;
}

// σ = softplus(−s/b) / b, of a field that is no distance.
Density softplus_density(float s, float b) {
  float inverse = 1.0 / b;
  float u = -s * inverse;
  float softplus = max(u, 0.0) + stable_log1p(exp(-abs(u)));
  float sigmoid = stable_sigmoid(u);
  Density density;
  density.value = softplus * inverse;
  density.d_sdf = -sigmoid * inverse * inverse;
  // An underflowed sigmoid times an infinite u would be NaN.
  density.d_b = -(softplus + (sigmoid > 0.0 ? u * sigmoid : 0.0)) * inverse * inverse;
  return density;
}

// kind: a specialization constant, DENSITY_LAPLACE or DENSITY_SOFTPLUS.
Density density_of(uint kind, float s, float b) {
  if (kind == DENSITY_SOFTPLUS) return softplus_density(s, b);
  return laplace_density(s, b);
}

#endif
