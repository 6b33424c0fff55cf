// Which pixels of a picture a training step looks at: beside chance, those where the rendering was wrong when it was last seen.
//
// A pool holds N pixels (those on the person, or those around). Without importance each is drawn with u = 1 / N. With the
// share s of importance, pixel i is drawn with
//   p(i) = (1 - s) / N + s m(i) / sum_j m(j),
// m: the error of its cell of 8 x 8 pixels, a running average. Its ray's loss l(i) counts with the weight u / p(i), so that
//   E_p[u / p(i) l(i)] = sum_i p(i) u / p(i) l(i) = (1 / N) sum_i l(i) = E_u[l(i)],
// and likewise the gradient: what is learnt from is the same in the mean, only its noise differs. The part left to chance bounds
// the weights: with m' the pool's mean of m, u / p(i) = 1 / (1 - s + s m(i) / m') <= 1 / (1 - s).
// Sources: importance sampling, Kahn and Marshall, "Methods of reducing sample size in Monte Carlo computations" (1953); the
// mixture, Hesterberg, "Weighted average importance sampling and defensive mixture distributions" (1995).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <random>
#include <span>
#include <vector>

#include "host/avatar/safetensors.h"
#include "host/training/training_images.h"

namespace arah {

class PoolImportance {
 public:
  static constexpr uint32_t cell_side = 8;  // pixels
  static constexpr float rate = 0.5f;       // of the running average: an error of four visits ago counts a sixteenth

  // places: column | row << 16, at least one. averages: what averages() gave for the same places; empty: nothing seen yet. Throws
  // std::invalid_argument where there are not as many as cells.
  explicit PoolImportance(std::span<const uint32_t> places, std::vector<float> averages = {});

  // Before the draws of a step. share: s, in [0, 1). Cells not seen yet count as the mean of the others.
  void prepare(double share);
  struct Drawn {
    std::size_t pixel = 0;  // of `places`
    float weight = 1;       // u / p
  };
  Drawn draw(std::mt19937_64& generator) const;
  // After the step: what was found at a drawn pixel, at least 0. One that is not finite is passed over.
  void see(std::size_t pixel, double error);

  // By cell, in the order of rows of cells; -1: not seen yet.
  const std::vector<float>& averages() const { return averages_; }

 private:
  std::vector<uint32_t> cells_;        // by pixel
  std::vector<uint32_t> order_;        // pixels by cell
  std::vector<std::size_t> begin_;     // of each cell in order_, and the end
  std::vector<float> averages_;        // by cell
  std::vector<double> cumulative_;     // N p up to each cell and with it
  std::vector<float> weights_;         // by cell
  double mean_ = 0;                    // m' at the last prepare(); 0: nothing seen
};

// The pools of all training pictures, made when first drawn from.
class RayImportance {
 public:
  // Of a picture (its index in TrainingImages::places()): the pixels on the person, or those around.
  // Throws InputError where what was loaded is not of this pool.
  PoolImportance& pool(std::size_t place, bool person, const std::vector<TrainingImage::Pixel>& pixels);

  // What was found out about a picture's pixels: they are others from now on.
  void forget(std::size_t place) { pools_.erase({place, 0}), pools_.erase({place, 1}), loaded_.erase({place, 0}), loaded_.erase({place, 1}); }

  // "training.ray_importance": averages of all pools, one after the other; "training.ray_importance_cells" [places][2]: how many are
  // each pool's, on the person and around, 0 where it was not drawn from.
  void save(SafetensorsFile& file, std::size_t places) const;
  // Throws InputError naming what does not fit.
  void load(const SafetensorsFile& file, std::size_t places);

 private:
  using Key = std::pair<std::size_t, std::size_t>;  // place; 0: on the person, 1: around
  std::map<Key, PoolImportance> pools_;
  std::map<Key, std::vector<float>> loaded_;  // of pools not drawn from since
};

}  // namespace arah
