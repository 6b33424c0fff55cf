// The cases of DESIGN.md, section 8, "At the extremes": what goes in, what must come out, and what came out, on the device.
// Each case is one call of a function below; all of them together are the page docs/extremes.md, which a run of all tests
// compares with its own (extremes.cpp). ARAH_WRITE_EXTREMES=1 writes the page and its pictures anew.
#pragma once

#include <gtest/gtest.h>

#include <span>
#include <string>
#include <vector>

namespace arah::extremes {

// The rows of section 8, in its words (row_title), and before them what it says of all: NaN and infinities are noticed.
enum class Row {
  not_a_number,
  laplace_scale,
  optical_depth,
  opaque_samples,
  few_samples,
  broyden,
  box,
  rotations,
  logits,
  softplus,
  sines,
  sizes,
  images,
  denormals,
  masks,
  counts,
  penalties,  // from here on beyond section 8
};
inline constexpr int row_count = static_cast<int>(Row::penalties) + 1;

// What Vulkan leaves of a formula of one exponential of x, a division and some products, relative to its value times (1 + |x|):
// exp may be 3 + 2 |x| units in the last place off, a division 2.5, a product half a one; a unit is 1.2e-7.
inline constexpr double float32_bound = 2e-6;

enum class Way { forward, backward };

// error: the largest one seen, in the unit that `expected` names. Fails the test where it is above the bound or no number.
void expect_within(Row row, Way way, const std::string& what, const std::string& expected, double error, double bound);

// An outcome that is there or not.
void expect_that(Row row, Way way, const std::string& what, const std::string& expected, bool came_out);

// An error in words: work() must throw an E whose text holds all of `words`.
template <class E, class Work>
void expect_error(Row row, Way way, const std::string& what, const std::vector<std::string>& words, Work&& work) {
  std::string found = "nothing was thrown", wanted;
  bool right = false;
  try {
    work();
  } catch (const E& error) {
    found = error.what();
    right = true;
  }
  for (const std::string& word : words) {
    right = right && found.find(word) != std::string::npos;
    wanted += (wanted.empty() ? "" : ", ") + ("“" + word + "”");
  }
  expect_that(row, way, what, "an error that says " + wanted, right);
  if (!right) ADD_FAILURE() << what << ": " << found;
}

// A picture of the page: docs/pictures/<name>.svg. Held for the end of the program, as the cases are.
void keep_picture(const std::string& name, const std::string& svg);

// Largest |found − truth| / (scale + |truth|); NaN where a number found is not finite or the lengths differ. `scale` is what an
// error is measured by where the truth is small.
double largest_error(std::span<const double> found, std::span<const double> truth, double scale);
// The same, relative to the largest |truth|.
double error_of_largest(std::span<const double> found, std::span<const double> truth);
// False for no values.
bool all_finite(std::span<const double> values);
bool all_zero(std::span<const double> values);

}  // namespace arah::extremes
