// The loss terms, unweighted, each with its gradient (ARAH.md section 7, golden 09). `rays` is N, the number of rays of
// the step, by which the sums are divided whatever the number of points. At kinks the derivative of |x| and of a norm
// is 0 at 0.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace arah::reference {

using Rgb = std::array<double, 3>;

struct ColorLoss {
  double value = 0;
  std::vector<Rgb> gradient;  // to rendered; 0 for rays that were not rendered
};
// Σ over rendered rays and channels q |rendered − photograph| / N. All spans: [rays]; rendered_mask 0 = not rendered; q:
// ray_weights, 1 each where empty.
ColorLoss color_loss(std::span<const Rgb> rendered, std::span<const Rgb> photograph,
                     std::span<const std::uint8_t> rendered_mask, double rays, std::span<const double> ray_weights = {});

struct EikonalLoss {
  double value = 0;
  std::vector<std::array<double, 3>> gradient;
};
// Σ | |∇f| − 1 | / N over the points' sdf gradients, both per cube unit.
EikonalLoss eikonal_loss(std::span<const std::array<double, 3>> sdf_gradients, double rays);

struct ScalarLoss {
  double value = 0;
  std::vector<double> gradient;  // to the first argument
};

// Σ exp(−100 f) / N over points well outside the body; f in cube units. Not bounded for f < 0: infinite from −7.1 on
// (in float32 from −0.88), where such a point has long been a failed training.
ScalarLoss off_surface_loss(std::span<const double> sdf, double rays);

// Σ sigmoid(5000 f) / N over points well inside the body; f in cube units.
ScalarLoss inside_loss(std::span<const double> sdf, double rays);

// Σ |f| / N over points of the surface, and Σ exp(−100 |f|) / N over points anywhere else, where no other surface is to
// be: the pre-training's terms (ARAH.md section 10). f in cube units; the derivative of |f| is 0 at 0.
ScalarLoss on_surface_loss(std::span<const double> sdf, double points);
ScalarLoss near_zero_loss(std::span<const double> sdf, double points);

// Σ (1 − cos(∇f, n)) / N over points of the surface with outward unit normals n; where ∇f is 0 the cosine counts as 0
// and there is no gradient.
EikonalLoss normal_loss(std::span<const std::array<double, 3>> sdf_gradients, std::span<const std::array<double, 3>> normals, double points);

// Mean over the points of Σ_b |w_b − w_b^template|. Both spans: [points][bones].
ScalarLoss skinning_loss(std::span<const double> weights, std::span<const double> template_weights, int bones);

// |φ|₂ / n over all generated SIREN weights φ (biases excluded), n = their number.
ScalarLoss parameter_loss(std::span<const double> parameters);

// Binary cross entropy of the rays' accumulated weights a, clamped to [1e-3, 1 − 1e-3], and the mask m in [0, 1]:
// −Σ q (m ln a + (1 − m) ln(1 − a)) / N. The gradient is 0 where the clamp holds a back. q: as in color_loss.
ScalarLoss alpha_loss(std::span<const double> weights_sum, std::span<const double> mask, double rays,
                      std::span<const double> ray_weights = {});

struct MaskLoss {
  double value = 0;
  std::vector<double> gradient;  // to the distances
  double d_alpha = 0;
};
// The mask loss of surface rendering (paper, appendix "Mask Loss"): Σ q BCE(m, sigmoid(−α f)) / (α N), f the rays' least
// distances in cube units, m their mask. BCE(m, sigmoid(−x)) = m ln(1 + eˣ) + (1 − m) ln(1 + e⁻ˣ). q: as in color_loss.
MaskLoss mask_loss(std::span<const double> least_sdf, std::span<const double> mask, double alpha, double rays, std::span<const double> ray_weights = {});

}  // namespace arah::reference
