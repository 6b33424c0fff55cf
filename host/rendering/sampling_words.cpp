// The words by which settings, files and reports name ways of sampling and searching.
#include "host/rendering/ray_samples.h"

namespace arah {

const char* to_string(SamplingMode mode) {
  switch (mode) {
    case SamplingMode::shell: return "shell";
    case SamplingMode::surface: return "surface";
    case SamplingMode::surface_only: return "surface_only";
    case SamplingMode::uniform: return "uniform";
  }
  return "shell";
}

const char* to_string(SurfaceSource source) { return source == SurfaceSource::mesh ? "mesh" : "search"; }

const char* to_string(Correspondence correspondence) {
  switch (correspondence) {
    case Correspondence::search: return "search";
    case Correspondence::search_from_grid: return "search_from_grid";
    case Correspondence::grid: return "grid";
    case Correspondence::grid_alone: return "grid_alone";
  }
  return "search";
}

}  // namespace arah
