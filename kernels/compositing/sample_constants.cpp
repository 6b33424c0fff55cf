#include "kernels/compositing/sample_constants.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace arah {

static_assert(uint32_t(DensityKind::laplace) == shared::DENSITY_LAPLACE && uint32_t(DensityKind::softplus) == shared::DENSITY_SOFTPLUS);

shared::CompositeConstants composite_constants(const CompositeSamples& s, float last_delta, float least_weight) {
  for (const Matrix* matrix : {&s.sdf, &s.rgb})
    if (matrix->stride % 4 || matrix->column % 4)
      throw std::invalid_argument(fmt::format("compositing: {} of stride {} at column {}, multiples of 4 expected",
                                              matrix == &s.sdf ? "sdf" : "colours", matrix->stride, matrix->column));
  if (s.rays == 0 || s.samples == 0)
    throw std::invalid_argument(fmt::format("compositing: {} rays of {} samples, at least 1 of each expected", s.rays, s.samples));
  // lavapipe ends every invocation after 65,535 loop iterations, silently; the walk forward makes two loops.
  if (s.samples > 30000)
    throw std::invalid_argument(fmt::format("compositing: {} samples a ray, at most 30000 are possible", s.samples));
  return {s.rays,       s.samples,     s.sdf.stride,      s.sdf.column, s.rgb.stride,
          s.rgb.column, s.scale_index, s.metres_per_unit, last_delta, least_weight};
}

uint64_t rgb_bytes(const CompositeSamples& s) {
  const uint64_t colored = s.slots.empty() ? uint64_t(s.rays) * s.samples : std::max<uint64_t>(s.slot_count, 1);
  return colored * s.rgb.stride * 4;
}

}  // namespace arah
