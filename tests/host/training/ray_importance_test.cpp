// Rays drawn by importance: weighted, their mean is that of rays drawn by chance; weights are bounded; what was seen is kept.
#include "host/training/ray_importance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr double share = 0.5;

// A slanted band of a picture of 70 x 50, so that cells are cut in all ways.
std::vector<uint32_t> band() {
  std::vector<uint32_t> places;
  for (uint32_t row = 3; row < 50; ++row)
    for (uint32_t column = row / 2; column < std::min(70u, row / 2 + 37); ++column) places.push_back(column | row << 16);
  return places;
}

// An error at each pixel: little on the whole, much in a corner, and different within each cell.
double error_at(uint32_t place) {
  const double column = place & 0xffff, row = place >> 16;
  return 0.05 + 2 * std::exp(-(std::pow(column - 30, 2) + std::pow(row - 40, 2)) / 60) + 0.02 * std::sin(column * row);
}

struct Mean {
  double sum = 0, squares = 0;
  int count = 0;
  void add(double x) { sum += x, squares += x * x, ++count; }
  double value() const { return sum / count; }
  double standard_error() const { return std::sqrt((squares / count - value() * value()) / (count - 1)); }
};

// A pool that has seen `rays` of its own draws.
PoolImportance learned(const std::vector<uint32_t>& places, int rays, std::mt19937_64& generator) {
  PoolImportance pool(places);
  for (int ray = 0; ray < rays; ray += 50) {
    pool.prepare(share);
    std::vector<std::size_t> drawn;
    for (int i = 0; i < 50; ++i) drawn.push_back(pool.draw(generator).pixel);
    for (const std::size_t pixel : drawn) pool.see(pixel, error_at(places[pixel]));
  }
  pool.prepare(share);
  return pool;
}

TEST(RayImportanceTest, TheWeightedMeanIsThatOfAllPixelsAndItsNoiseLess) {
  const std::vector<uint32_t> places = band();
  double truth = 0;
  Mean by_chance;
  for (const uint32_t place : places) {
    truth += error_at(place) / static_cast<double>(places.size());
    by_chance.add(error_at(place));
  }
  std::mt19937_64 generator(7);
  const PoolImportance pool = learned(places, 1000, generator);
  Mean weighted, unweighted, weights;
  for (int ray = 0; ray < 100000; ++ray) {
    const PoolImportance::Drawn drawn = pool.draw(generator);
    const double loss = error_at(places[drawn.pixel]);
    weighted.add(double{drawn.weight} * loss);
    unweighted.add(loss);
    weights.add(double{drawn.weight});
  }
  const double one_by_chance = by_chance.standard_error() * std::sqrt(by_chance.count - 1.0), one_weighted = weighted.standard_error() * std::sqrt(weighted.count - 1.0);
  std::printf("  all pixels %.5f; weighted %.5f ± %.5f; without weights %.5f; deviation of one ray by chance %.4f, weighted %.4f\n", truth, weighted.value(), weighted.standard_error(), unweighted.value(), one_by_chance, one_weighted);
  EXPECT_NEAR(weighted.value(), truth, 4 * weighted.standard_error());
  EXPECT_NEAR(weights.value(), 1, 4 * weights.standard_error());
  EXPECT_GT(unweighted.value() - truth, 40 * unweighted.standard_error()) << "without the weights this would be learnt from";
  EXPECT_LT(one_weighted, 0.7 * one_by_chance);
}

// Not the losses' alone: any function of the pixel keeps its mean, one that has nothing to do with the errors too.
TEST(RayImportanceTest, EveryPixelIsDrawnAsOftenAsItsWeightSays) {
  const std::vector<uint32_t> places = band();
  std::mt19937_64 generator(8);
  const PoolImportance pool = learned(places, 1000, generator);
  constexpr int draws = 400000;
  std::vector<double> mass(places.size());
  for (int ray = 0; ray < draws; ++ray) {
    const PoolImportance::Drawn drawn = pool.draw(generator);
    mass[drawn.pixel] += double{drawn.weight} / draws;
  }
  // Each should be 1 / N, with a variance of at most weight / (draws N): chi squared over N with its own deviation.
  const auto n = static_cast<double>(places.size());
  double squares = 0, largest = 0;
  for (const double x : mass) {
    squares += std::pow(x - 1 / n, 2) * draws * n;
    largest = std::max(largest, std::abs(x * n - 1));
  }
  EXPECT_LT(squares / n, 2 * 1.2);
  EXPECT_GT(squares / n, 0.2);
  EXPECT_LT(largest, 6 * std::sqrt(2 * n / draws)) << "a pixel that is drawn too often, or never";
}

TEST(RayImportanceTest, WeightsLieBelowOneOverTheShareOfChance) {
  const std::vector<uint32_t> places = band();
  for (const double some : {0.1, 0.5, 0.9}) {
    PoolImportance pool(places);
    std::mt19937_64 generator(9);
    const auto range = [&] {
      pool.prepare(some);
      float least = std::numeric_limits<float>::infinity(), most = 0;
      for (int ray = 0; ray < 20000; ++ray) {
        const float weight = pool.draw(generator).weight;
        least = std::min(least, weight), most = std::max(most, weight);
      }
      return std::pair{double{least}, double{most}};
    };
    EXPECT_EQ(range(), (std::pair{1.0, 1.0})) << "nothing seen yet";
    for (std::size_t pixel = 0; pixel < places.size(); ++pixel) pool.see(pixel, 0);
    EXPECT_EQ(range(), (std::pair{1.0, 1.0})) << "no error anywhere";
    pool.see(0, 1e30);
    auto [least, most] = range();
    EXPECT_NEAR(most, 1 / (1 - some), 1e-6 / (1 - some));
    EXPECT_GT(least, 0);
    pool.see(5, std::numeric_limits<double>::quiet_NaN());
    pool.see(5, std::numeric_limits<double>::infinity());
    const auto [again_least, again_most] = range();
    EXPECT_EQ(again_least, least) << "what is not finite is not noted";
    EXPECT_EQ(again_most, most);
  }
  PoolImportance single(std::vector<uint32_t>{5 | 7 << 16});
  single.prepare(share);
  std::mt19937_64 generator(1);
  EXPECT_EQ(single.draw(generator).pixel, 0u);
  EXPECT_EQ(single.draw(generator).weight, 1);
}

TEST(RayImportanceTest, WithoutAShareAllIsChance) {
  const std::vector<uint32_t> places = band();
  std::mt19937_64 generator(10);
  PoolImportance pool = learned(places, 1000, generator);
  pool.prepare(0);
  for (int ray = 0; ray < 1000; ++ray) EXPECT_EQ(pool.draw(generator).weight, 1);
}

TEST(RayImportanceTest, WhatWasSavedGoesOnWithTheSameDraws) {
  std::vector<TrainingImage::Pixel> pixels, others;
  for (const uint32_t place : band()) pixels.push_back({place, {}});
  others.assign(pixels.begin(), pixels.begin() + 300);
  std::mt19937_64 generator(11);
  RayImportance first;
  const auto train = [&](RayImportance& importance, std::mt19937_64& random) {
    std::vector<std::pair<std::size_t, float>> all;
    for (const std::size_t place : {0, 2})
      for (const bool person : {true, false}) {
        const auto& some = person ? pixels : others;
        PoolImportance& pool = importance.pool(place, person, some);
        pool.prepare(share);
        for (int ray = 0; ray < 40; ++ray) {
          const PoolImportance::Drawn drawn = pool.draw(random);
          all.emplace_back(drawn.pixel, drawn.weight);
        }
        for (int ray = 0; ray < 40; ++ray) pool.see(all[all.size() - 40 + static_cast<std::size_t>(ray)].first, error_at(some[all[all.size() - 40 + static_cast<std::size_t>(ray)].first].place));
      }
    return all;
  };
  for (int step = 0; step < 5; ++step) train(first, generator);
  SafetensorsFile file;
  first.save(file, 3);
  EXPECT_EQ(file.at("training.ray_importance_cells").as<int64_t>()[2], 0) << "place 1 was never drawn from";
  RayImportance second;
  second.load(file, 3);
  SafetensorsFile untouched;
  second.save(untouched, 3);
  EXPECT_EQ(untouched.at("training.ray_importance").as<float>(), file.at("training.ray_importance").as<float>()) << "saved before it was used";
  std::mt19937_64 same = generator;
  for (int step = 0; step < 3; ++step) EXPECT_EQ(train(second, same), train(first, generator));

  EXPECT_THROW(second.load(file, 4), InputError) << "another number of pictures";
  SafetensorsFile bad = file;
  bad.tensors.erase("training.ray_importance");
  EXPECT_THROW(second.load(bad, 3), InputError);
  bad = file;
  std::vector<float> averages = file.at("training.ray_importance").as<float>();
  averages[1] = std::numeric_limits<float>::quiet_NaN();
  bad.tensors["training.ray_importance"] = Tensor::from<float>({static_cast<int64_t>(averages.size())}, averages);
  EXPECT_THROW(second.load(bad, 3), InputError);
  bad = file;
  std::vector<int64_t> cells = file.at("training.ray_importance_cells").as<int64_t>();
  cells[0] += 1;
  bad.tensors["training.ray_importance_cells"] = Tensor::from<int64_t>({3, 2}, cells);
  EXPECT_THROW(second.load(bad, 3), InputError);
  cells[1] -= 1;  // the sum is right again, the pools are not
  bad.tensors["training.ray_importance_cells"] = Tensor::from<int64_t>({3, 2}, cells);
  second.load(bad, 3);
  EXPECT_THROW(second.pool(0, true, pixels), InputError);
}

}  // namespace
}  // namespace arah
