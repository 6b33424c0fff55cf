#include "host/training/ray_importance.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr const char* kAverages = "training.ray_importance";
constexpr const char* kCells = "training.ray_importance_cells";
constexpr float kUnseen = -1;

}  // namespace

PoolImportance::PoolImportance(std::span<const uint32_t> places, std::vector<float> averages) {
  // Cells in the order of (row, column) that have a pixel.
  std::vector<std::pair<uint32_t, uint32_t>> corners;
  const auto corner = [](uint32_t place) { return std::pair{(place >> 16) / cell_side, (place & 0xffff) / cell_side}; };
  for (const uint32_t place : places) corners.push_back(corner(place));
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  begin_.assign(corners.size() + 1, 0);
  for (const uint32_t place : places) {
    const auto cell = static_cast<std::size_t>(std::lower_bound(corners.begin(), corners.end(), corner(place)) - corners.begin());
    cells_.push_back(static_cast<uint32_t>(cell));
    ++begin_[cell + 1];
  }
  std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
  std::vector<std::size_t> next(begin_.begin(), begin_.end() - 1);
  order_.resize(places.size());
  for (std::size_t pixel = 0; pixel < places.size(); ++pixel) order_[next[cells_[pixel]]++] = static_cast<uint32_t>(pixel);
  averages_ = averages.empty() ? std::vector<float>(corners.size(), kUnseen) : std::move(averages);
  if (averages_.size() != corners.size()) throw std::invalid_argument(fmt::format("ray importance: {} averages of {} cells", averages_.size(), corners.size()));
}

void PoolImportance::prepare(double share) {
  double seen = 0, pixels = 0;
  const auto size = [&](std::size_t cell) { return static_cast<double>(begin_[cell + 1] - begin_[cell]); };
  for (std::size_t cell = 0; cell < averages_.size(); ++cell) {
    if (averages_[cell] < 0) continue;
    seen += size(cell) * double{averages_[cell]};
    pixels += size(cell);
  }
  mean_ = pixels > 0 ? seen / pixels : 0;  // of all pixels, since the unseen ones count as this
  cumulative_.resize(averages_.size());
  weights_.resize(averages_.size());
  double sum = 0;
  for (std::size_t cell = 0; cell < averages_.size(); ++cell) {
    const double ratio = averages_[cell] >= 0 && mean_ > 0 ? double{averages_[cell]} / mean_ : 1;
    const double density = 1 - share + share * ratio;  // p / u
    weights_[cell] = static_cast<float>(1 / density);
    cumulative_[cell] = sum += size(cell) * density;
  }
}

PoolImportance::Drawn PoolImportance::draw(std::mt19937_64& generator) const {
  const double at = std::uniform_real_distribution<double>(0, cumulative_.back())(generator);
  const auto found = std::upper_bound(cumulative_.begin(), cumulative_.end(), at);
  const std::size_t cell = std::min(static_cast<std::size_t>(found - cumulative_.begin()), cumulative_.size() - 1);
  return {order_[std::uniform_int_distribution<std::size_t>(begin_[cell], begin_[cell + 1] - 1)(generator)], weights_[cell]};
}

void PoolImportance::see(std::size_t pixel, double error) {
  if (!std::isfinite(error)) return;
  float& average = averages_[cells_[pixel]];
  const auto found = static_cast<float>(error);
  // What was expected of a cell not seen yet is the pool's mean: one ray alone does not make it important or not.
  const float before = average >= 0 ? average : mean_ > 0 ? static_cast<float>(mean_) : found;
  average = before + rate * (found - before);
}

PoolImportance& RayImportance::pool(std::size_t place, bool person, const std::vector<TrainingImage::Pixel>& pixels) {
  const Key key{place, person ? 0 : 1};
  const auto made = pools_.find(key);
  if (made != pools_.end()) return made->second;
  std::vector<uint32_t> places;
  places.reserve(pixels.size());
  for (const TrainingImage::Pixel& pixel : pixels) places.push_back(pixel.place);
  std::vector<float> averages;
  if (const auto saved = loaded_.find(key); saved != loaded_.end()) averages = std::move(saved->second), loaded_.erase(saved);
  const std::size_t count = averages.size();
  try {
    return pools_.emplace(key, PoolImportance(places, std::move(averages))).first->second;
  } catch (const std::invalid_argument& error) {
    throw InputError("checkpoint", kAverages, fmt::format("the cells of picture {} as its mask has them", place), fmt::format("{} ({})", count, error.what()), "Has the capture changed since the run began?");
  }
}

void RayImportance::save(SafetensorsFile& file, std::size_t places) const {
  std::vector<float> averages;
  std::vector<int64_t> cells(2 * places, 0);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const Key key{i / 2, i % 2};
    const auto made = pools_.find(key);
    const auto waiting = loaded_.find(key);
    if (made == pools_.end() && waiting == loaded_.end()) continue;
    const std::vector<float>& some = made != pools_.end() ? made->second.averages() : waiting->second;
    cells[i] = static_cast<int64_t>(some.size());
    averages.insert(averages.end(), some.begin(), some.end());
  }
  file.tensors[kAverages] = Tensor::from<float>({static_cast<int64_t>(averages.size())}, averages);
  file.tensors[kCells] = Tensor::from<int64_t>({static_cast<int64_t>(places), 2}, cells);
}

void RayImportance::load(const SafetensorsFile& file, std::size_t places) {
  const auto cells = file.values<int64_t>(kCells, {static_cast<int64_t>(places), 2});
  const int64_t stored = file.at(kAverages).count();
  int64_t sum = 0;
  for (const int64_t count : cells) {
    if (count < 0 || count > stored - sum) throw InputError(file.path.string(), kCells, fmt::format("counts that add up to {}", stored), fmt::format("one of {}", count));
    sum += count;
  }
  if (sum != stored) throw InputError(file.path.string(), kCells, fmt::format("counts that add up to {}", stored), fmt::format("{}", sum));
  const auto averages = file.values<float>(kAverages, {stored});
  for (const float average : averages)
    if (!std::isfinite(average) || (average < 0 && average != kUnseen)) throw InputError(file.path.string(), kAverages, "errors of at least 0, or -1", fmt::format("{}", average));
  pools_.clear();
  loaded_.clear();
  auto from = averages.begin();
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (cells[i] > 0) loaded_[{i / 2, i % 2}] = std::vector<float>(from, from + cells[i]);
    from += cells[i];
  }
}

}  // namespace arah
