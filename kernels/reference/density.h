// Laplace density of a signed distance (VolSDF; ARAH.md section 6):
//   σ(s, b) = (1/b)·(½ + ½ sign(−s)(1 − exp(−|s|/b))),   outside (s > 0): σ = exp(−s/b) / (2b).
// The second form is used there: the first cancels to 0 from s of some 16 b in float32.
// And the density of a field that is no distance, as a radiance field has it (NeRF): σ = softplus(−s/b) / b, where −s/b is
// the raw density. Deep outside both are exponentials; inside this one has no bound.
#pragma once

namespace arah::reference {

inline constexpr double kMinLaplaceScale = 1e-6;  // metres, bounds of b
inline constexpr double kMaxLaplaceScale = 1e6;

// b of its free parameter, metres: |parameter| clipped to [1e-6, 1e6].
double laplace_scale(double parameter);

// db/dparameter: the sign of the parameter where |parameter| lies within the bounds, bounds included; 0 elsewhere.
double laplace_scale_derivative(double parameter);

struct Density {
  double value = 0;  // σ, 1/m; in [0, 1/b]
  double d_sdf = 0;  // ∂σ/∂s; 0 at s = 0, where the formula's sign and absolute value are both taken as flat
  double d_b = 0;    // ∂σ/∂b
};

// `sdf` in metres (positive outside), `b` in metres within the bounds above.
Density laplace_density(double sdf, double b);

// σ = softplus(−s/b) / b in [0, ∞); s in metres as above, b the same.
Density softplus_density(double s, double b);

enum class DensityKind { laplace, softplus };
inline Density density_of(DensityKind kind, double s, double b) {
  return kind == DensityKind::laplace ? laplace_density(s, b) : softplus_density(s, b);
}

}  // namespace arah::reference
