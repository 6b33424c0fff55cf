// LPIPS with networks small enough to be written here and computed again in double precision.
#include "host/evaluation/lpips.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <vector>

#include "host/evaluation/onnx_model.h"
#include "host/input_error.h"
#include "tests/host/body/rigs.h"
#include "tests/host/evaluation/onnx_file.h"
#include "tests/host/evaluation/weighted_difference.h"

namespace arah {
namespace {

using onnx::open;
using testing::AllOf;
using testing::HasSubstr;

// Numbers that differ from pixel to pixel and channel to channel.
std::vector<float> pattern(int width, int height, unsigned seed) {
  std::vector<float> rgb;
  uint32_t state = seed;
  for (int i = 0; i < 3 * width * height; ++i) {
    state = state * 1664525 + 1013904223;
    rgb.push_back(static_cast<float>(state >> 8) / float(1 << 24));
  }
  return rgb;
}

// [channels][height][width], double precision.
struct Map {
  std::size_t channels = 0, height = 0, width = 0;
  std::vector<double> values;
  Map(std::size_t c, std::size_t h, std::size_t w) : channels(c), height(h), width(w), values(c * h * w) {}
  double& at(std::size_t c, std::size_t y, std::size_t x) { return values[(c * height + y) * width + x]; }
  double at(std::size_t c, std::size_t y, std::size_t x) const { return values[(c * height + y) * width + x]; }
};

// As the network sees the crop: 2x - 1, R G B.
Map seen(const std::vector<float>& rgb, int width, const CropRectangle& crop) {
  Map map(3, static_cast<std::size_t>(crop.y1 - crop.y0), static_cast<std::size_t>(crop.x1 - crop.x0));
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t y = 0; y < map.height; ++y)
      for (std::size_t x = 0; x < map.width; ++x) map.at(c, y, x) = 2.0 * double{rgb[3 * ((y + static_cast<std::size_t>(crop.y0)) * static_cast<std::size_t>(width) + x + static_cast<std::size_t>(crop.x0)) + c]} - 1;
  return map;
}

// 3x3, one pixel of zeros around, then max(0, .). weights: [out][in][3][3].
Map convolved(const Map& in, const std::vector<float>& weights, const std::vector<float>& bias) {
  Map out(bias.size(), in.height, in.width);
  for (std::size_t o = 0; o < out.channels; ++o)
    for (std::size_t y = 0; y < in.height; ++y)
      for (std::size_t x = 0; x < in.width; ++x) {
        double sum = double{bias[o]};
        for (std::size_t i = 0; i < in.channels; ++i)
          for (std::size_t dy = 0; dy < 3; ++dy)
            for (std::size_t dx = 0; dx < 3; ++dx)
              if (y + dy >= 1 && y + dy <= in.height && x + dx >= 1 && x + dx <= in.width) sum += double{weights[((o * in.channels + i) * 3 + dy) * 3 + dx]} * in.at(i, y + dy - 1, x + dx - 1);
        out.at(o, y, x) = std::max(sum, 0.0);
      }
  return out;
}

Map halved(const Map& in) {  // the largest of 2x2, an odd row or column at the end left out
  Map out(in.channels, in.height / 2, in.width / 2);
  for (std::size_t c = 0; c < out.channels; ++c)
    for (std::size_t y = 0; y < out.height; ++y)
      for (std::size_t x = 0; x < out.width; ++x)
        out.at(c, y, x) = std::max(std::max(in.at(c, 2 * y, 2 * x), in.at(c, 2 * y, 2 * x + 1)), std::max(in.at(c, 2 * y + 1, 2 * x), in.at(c, 2 * y + 1, 2 * x + 1)));
  return out;
}

// Mean over the pixels of sum_c w_c (a_c / |a| - b_c / |b|)^2.
double layer_distance(const Map& a, const Map& b, const std::vector<float>& weights) {
  double sum = 0;
  for (std::size_t y = 0; y < a.height; ++y)
    for (std::size_t x = 0; x < a.width; ++x) {
      double of_a = 0, of_b = 0;
      for (std::size_t c = 0; c < a.channels; ++c) of_a += a.at(c, y, x) * a.at(c, y, x), of_b += b.at(c, y, x) * b.at(c, y, x);
      for (std::size_t c = 0; c < a.channels; ++c) sum += double{weights[c]} * std::pow(a.at(c, y, x) / (std::sqrt(of_a) + 1e-10) - b.at(c, y, x) / (std::sqrt(of_b) + 1e-10), 2);
    }
  return sum / static_cast<double>(a.height * a.width);
}

// The authors' network with two layers of a few channels instead of VGG's five: scaling, convolutions, features divided by
// their length, squared differences weighted by a 1x1 convolution, means over the pixels, their sum. The operators are those
// that PyTorch exports for it.
struct SmallLpips {
  const std::vector<float> shift{-0.03f, -0.088f, -0.188f}, scale{0.458f, 0.448f, 0.45f};
  const std::vector<float> w1 = weights(4 * 3 * 9, 5), b1{0.1f, -0.1f, 0.2f, 0.05f};
  const std::vector<float> w2 = weights(5 * 4 * 9, 6), b2{0.1f, 0.2f, 0.15f, -0.05f, 0.3f};
  const std::vector<float> lin1{0.1f, 0.2f, 0.3f, 0.4f}, lin2{0.5f, 0.1f, 0.2f, 0.4f, 0.3f};

  static std::vector<float> weights(int count, unsigned seed) {
    std::vector<float> values = pattern(count, 1, seed);
    values.resize(static_cast<std::size_t>(count));
    for (float& value : values) value -= 0.45f;
    return values;
  }

  // As PyTorch exports it: with constants of their own or by nodes. From operator set 13 on the axes of a sum are an input.
  std::string file(bool constant_nodes = false, int operator_set = 11) const {
    onnx::Graph graph;
    const auto constant = [&](const std::string& name, const std::vector<int64_t>& shape, const std::vector<float>& values) { constant_nodes ? graph.constant_node(name, shape, values) : graph.constant(name, shape, values); };
    graph.input("in0", {open, 3, open, open});
    graph.input("in1", {open, 3, open, open});
    graph.output("distance", {open, 1, 1, 1});
    constant("shift", {1, 3, 1, 1}, shift);
    constant("scale", {1, 3, 1, 1}, scale);
    constant("two", {}, {2});
    constant("eps", {}, {1e-10f});
    graph.constant("channels", {1});
    graph.constant("w1", {4, 3, 3, 3}, w1);
    graph.constant("b1", {4}, b1);
    graph.constant("w2", {5, 4, 3, 3}, w2);
    graph.constant("b2", {5}, b2);
    graph.constant("lin1", {1, 4, 1, 1}, lin1);
    graph.constant("lin2", {1, 5, 1, 1}, lin2);
    const std::vector<onnx::Graph::Integers> three{{"kernel_shape", {3, 3}}, {"pads", {1, 1, 1, 1}}, {"strides", {1, 1}}};
    for (const std::string side : {"0", "1"}) {
      graph.node("Sub", {"in" + side, "shift"}, "shifted" + side);
      graph.node("Div", {"shifted" + side, "scale"}, "scaled" + side);
      graph.node("Conv", {"scaled" + side, "w1", "b1"}, "c1" + side, three);
      graph.node("Relu", {"c1" + side}, "f1" + side);
      graph.node("MaxPool", {"f1" + side}, "p1" + side, {{"kernel_shape", {2, 2}}, {"strides", {2, 2}}});
      graph.node("Conv", {"p1" + side, "w2", "b2"}, "c2" + side, three);
      graph.node("Relu", {"c2" + side}, "f2" + side);
      for (const std::string layer : {"1", "2"}) {
        const std::string f = "f" + layer + side;
        graph.node("Pow", {f, "two"}, f + "_squared");
        if (operator_set < 13) graph.node("ReduceSum", {f + "_squared"}, f + "_sum", {{"axes", {1}}, {"keepdims", {1}, true}});
        else graph.node("ReduceSum", {f + "_squared", "channels"}, f + "_sum", {{"keepdims", {1}, true}});
        graph.node("Sqrt", {f + "_sum"}, f + "_length");
        graph.node("Add", {f + "_length", "eps"}, f + "_divisor");
        graph.node("Div", {f, f + "_divisor"}, f + "_unit");
      }
    }
    for (const std::string layer : {"1", "2"}) {
      graph.node("Sub", {"f" + layer + "0_unit", "f" + layer + "1_unit"}, "d" + layer);
      graph.node("Pow", {"d" + layer, "two"}, "s" + layer);
      graph.node("Conv", {"s" + layer, "lin" + layer}, "l" + layer, {{"kernel_shape", {1, 1}}});
      graph.node("ReduceMean", {"l" + layer}, "m" + layer, {{"axes", {2, 3}}, {"keepdims", {1}, true}});
    }
    graph.node("Add", {"m1", "m2"}, "distance");
    return graph.file(operator_set);
  }

  double distance(const Map& a, const Map& b) const {
    const auto scaled = [&](Map map) {
      for (std::size_t c = 0; c < 3; ++c)
        for (std::size_t i = 0; i < map.height * map.width; ++i) map.values[c * map.height * map.width + i] = (map.values[c * map.height * map.width + i] - double{shift[c]}) / double{scale[c]};
      return map;
    };
    const Map a1 = convolved(scaled(a), w1, b1), b1_ = convolved(scaled(b), w1, b1);
    return layer_distance(a1, b1_, lin1) + layer_distance(convolved(halved(a1), w2, b2), convolved(halved(b1_), w2, b2), lin2);
  }
};

class LpipsTest : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& bytes) {
    const std::filesystem::path path = folder / name;
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  }
  // Must be refused with what the user needs to know.
  void expect_refused(const std::string& name, const std::string& bytes, const std::vector<std::string>& parts) {
    const std::filesystem::path path = write(name, bytes);
    try {
      Lpips lpips(path);
      ADD_FAILURE() << name << " was accepted";
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), AllOf(HasSubstr(path.string()), HasSubstr("expected"), HasSubstr("found")));
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
      for (const std::string& part : parts) EXPECT_THAT(error.what(), HasSubstr(part));
    }
  }
  TemporaryFolder folder;
};

TEST_F(LpipsTest, IsWhatTheNetworkSaysOfTheCropsInRgbFromMinusOneToOne) {
  const std::vector<float> weights{0.5f, 0.3f, 0.125f};
  Lpips lpips(write("weighted.onnx", weighted_difference_network(weights)));
  const int width = 23, height = 19;
  const CropRectangle crop{3, 2, 20, 17};
  const std::vector<float> a = pattern(width, height, 1), b = pattern(width, height, 2);
  const Map of_a = seen(a, width, crop), of_b = seen(b, width, crop);
  double truth = 0;
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t y = 0; y < of_a.height; ++y)
      for (std::size_t x = 0; x < of_a.width; ++x) truth += double{weights[c]} * std::abs(of_a.at(c, y, x) - of_b.at(c, y, x));
  truth /= static_cast<double>(of_a.height * of_a.width);
  EXPECT_NEAR(lpips.distance({a, width, height}, {b, width, height}, crop), truth, 1e-6);
  EXPECT_EQ(lpips.distance({a, width, height}, {a, width, height}, crop), 0);

  // A red picture and a blue one, each against black: the weights of R and of B, twice because 0 and 1 are seen as -1 and 1.
  std::vector<float> black(3 * 8 * 8, 0.0f), red = black, blue = black;
  for (std::size_t i = 0; i < red.size(); i += 3) red[i] = blue[i + 2] = 1;
  EXPECT_NEAR(lpips.distance({red, 8, 8}, {black, 8, 8}, {0, 0, 8, 8}), 2 * 0.5, 1e-6);
  EXPECT_NEAR(lpips.distance({blue, 8, 8}, {black, 8, 8}, {0, 0, 8, 8}), 2 * 0.125, 1e-6);
}

// Of what is seen, not only of differences: a shift of both pictures would cancel in those.
TEST_F(LpipsTest, TheNetworkSeesMinusOneForBlackAndOneForWhite) {
  onnx::Graph graph;  // mean of |a^2 - b^2|
  graph.input("x", {1, 3, open, open});
  graph.input("y", {1, 3, open, open});
  graph.output("d", {});
  graph.constant("third", {1, 3, 1, 1}, {1 / 3.0f, 1 / 3.0f, 1 / 3.0f});
  graph.constant("two", {}, {2});
  graph.node("Pow", {"x", "two"}, "xx");
  graph.node("Pow", {"y", "two"}, "yy");
  graph.node("Sub", {"xx", "yy"}, "minus");
  graph.node("Abs", {"minus"}, "plus");
  graph.node("Conv", {"plus", "third"}, "gray", {{"kernel_shape", {1, 1}}});
  graph.node("GlobalAveragePool", {"gray"}, "d");
  Lpips lpips(write("squares.onnx", graph.file()));
  const std::vector<float> black(3 * 8 * 9, 0.0f), white(3 * 8 * 9, 1.0f), gray(3 * 8 * 9, 0.5f);
  const CropRectangle all{0, 0, 8, 9};
  EXPECT_NEAR(lpips.distance({black, 8, 9}, {white, 8, 9}, all), 0, 1e-6);
  EXPECT_NEAR(lpips.distance({black, 8, 9}, {gray, 8, 9}, all), 1, 1e-6);
}

TEST_F(LpipsTest, ANetworkOfTheAuthorsFormFollowsDoublePrecisionAtEverySize) {
  const SmallLpips network;
  const int width = 61, height = 57;
  const std::vector<float> a = pattern(width, height, 3), b = pattern(width, height, 4);
  for (const bool constant_nodes : {false, true}) {
    Lpips lpips(write("small.onnx", network.file(constant_nodes)));
    for (const CropRectangle& crop : {CropRectangle{0, 0, 61, 57}, CropRectangle{5, 7, 52, 38}, CropRectangle{5, 7, 12, 38}, CropRectangle{0, 0, 61, 57}}) {
      const double truth = network.distance(seen(a, width, crop), seen(b, width, crop));
      const double found = lpips.distance({a, width, height}, {b, width, height}, crop);
      std::printf("  %d x %d: %.6f, off by %.1e\n", crop.x1 - crop.x0, crop.y1 - crop.y0, found, std::abs(found - truth));
      EXPECT_GT(truth, 0.05);
      EXPECT_NEAR(found, truth, 2e-6 * truth);
      EXPECT_EQ(lpips.distance({a, width, height}, {a, width, height}, crop), 0);
    }
  }
}

TEST_F(LpipsTest, RefusesAFileThatIsNotTheNetwork) {
  const std::string good = weighted_difference_network({1, 1, 1});
  ASSERT_NO_THROW(Lpips(write("good.onnx", good)));
  expect_refused("text.onnx", "hello, this is a text and no network\n", {"ONNX file", "37 bytes"});
  expect_refused("empty.onnx", "", {"0 bytes", "no graph"});
  expect_refused("cut.onnx", good.substr(0, good.size() / 2), {"cut short"});
  for (std::size_t bytes = 1; bytes < good.size(); bytes += 7) {
    const std::filesystem::path path = write("part.onnx", good.substr(0, bytes));
    EXPECT_THROW(Lpips{path}, InputError) << "the first " << bytes << " of " << good.size() << " bytes";
  }
  try {
    Lpips lpips(folder / "missing.onnx");
    ADD_FAILURE();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("missing.onnx"), HasSubstr("no such file")));
  }
  EXPECT_THROW(Lpips{folder.path()}, InputError) << "a folder";

  const auto graph = [](const std::vector<std::pair<std::string, std::vector<int64_t>>>& inputs, int type, const std::string& pooling, const std::vector<std::string>& outputs) {
    onnx::Graph made;
    for (const auto& [name, shape] : inputs) made.input(name, shape, type);
    for (const std::string& name : outputs) made.output(name, {open, 1, 1, 1});
    made.node("Sub", {"a", inputs.size() > 1 ? "b" : "a"}, "minus");
    made.node("Abs", {"minus"}, "plus");
    made.node(pooling, {"plus"}, "d", pooling == "GlobalAveragePool" ? std::vector<onnx::Graph::Integers>{} : std::vector<onnx::Graph::Integers>{{"axes", {1}}, {"keepdims", {1}, true}});
    return made.file();
  };
  const std::vector<int64_t> pictures{open, 3, open, open};
  expect_refused("one.onnx", graph({{"a", pictures}}, 1, "GlobalAveragePool", {"d"}), {"inputs", "expected two", "'a' float32 [?, 3, ?, ?]"});
  expect_refused("three.onnx", graph({{"a", pictures}, {"b", pictures}, {"c", pictures}}, 1, "GlobalAveragePool", {"d"}), {"inputs", "'c'"});
  expect_refused("gray.onnx", graph({{"a", {open, 1, open, open}}, {"b", {open, 1, open, open}}}, 1, "GlobalAveragePool", {"d"}), {"inputs", "[?, 1, ?, ?]"});
  expect_refused("fixed.onnx", graph({{"a", {1, 3, 64, 64}}, {"b", {1, 3, 64, 64}}}, 1, "GlobalAveragePool", {"d"}), {"inputs", "[1, 3, 64, 64]", "left open"});
  expect_refused("channels_last.onnx", graph({{"a", {open, open, open, 3}}, {"b", {open, open, open, 3}}}, 1, "GlobalAveragePool", {"d"}), {"inputs", "[?, ?, ?, 3]"});
  expect_refused("half.onnx", graph({{"a", pictures}, {"b", pictures}}, 10, "GlobalAveragePool", {"d"}), {"inputs", "of type 10"});
  expect_refused("outputs.onnx", graph({{"a", pictures}, {"b", pictures}}, 1, "GlobalAveragePool", {"d", "plus"}), {"outputs", "'plus'"});
  expect_refused("map.onnx", graph({{"a", pictures}, {"b", pictures}}, 1, "ReduceSum", {"d"}), {"output", "one number", "5120"});
  expect_refused("unknown.onnx", graph({{"a", pictures}, {"b", pictures}}, 1, "Perceive", {"d"}), {"OpenCV", "Perceive"});

  expect_refused("newer.onnx", SmallLpips().file(false, 13), {"OpenCV", "opset_version=11"});

  onnx::Graph sum;  // two pictures, one number, and no distance
  sum.input("a", pictures);
  sum.input("b", pictures);
  sum.output("d", {open, 1, 1, 1});
  sum.constant("w", {1, 3, 1, 1}, {1, 1, 1});
  sum.node("Add", {"a", "b"}, "both");
  sum.node("Conv", {"both", "w"}, "gray", {{"kernel_shape", {1, 1}}});
  sum.node("GlobalAveragePool", {"gray"}, "d");
  expect_refused("sum.onnx", sum.file(), {"0 for equal pictures"});
}

TEST_F(LpipsTest, RefusesPicturesThatDoNotFit) {
  Lpips lpips(write("weighted.onnx", weighted_difference_network({1, 1, 1})));
  std::vector<float> picture(3 * 8 * 8, 0.5f);
  const RgbPicture fits{picture, 8, 8};
  EXPECT_NO_THROW(lpips.distance(fits, fits, {0, 0, 8, 8}));
  EXPECT_THROW(lpips.distance(fits, fits, {0, 0, 9, 8}), std::invalid_argument);
  EXPECT_THROW(lpips.distance(fits, fits, {-1, 0, 8, 8}), std::invalid_argument);
  EXPECT_THROW(lpips.distance(fits, fits, {4, 4, 4, 8}), std::invalid_argument);
  EXPECT_THROW(lpips.distance(fits, {picture, 8, 7}, {0, 0, 8, 7}), std::invalid_argument);
  picture[3 * 9] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(lpips.distance(fits, fits, {0, 0, 8, 8}), std::invalid_argument);
  EXPECT_NO_THROW(lpips.distance(fits, fits, {2, 2, 8, 8})) << "outside the crop nothing is read";

  // The small network halves its pictures once: one row is too low for it.
  Lpips small(write("small.onnx", SmallLpips().file()));
  picture[3 * 9] = 0.5f;
  try {
    small.distance(fits, fits, {0, 0, 8, 1});
    ADD_FAILURE() << "one row";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("small.onnx"), HasSubstr("8 x 1")));
  }
  EXPECT_NO_THROW(small.distance(fits, fits, {0, 0, 8, 8})) << "after a refusal";
}

TEST(OnnxModelTest, ReadsWhatTheFileSaysAndDeclaresItsInputsAnew) {
  const std::string file = SmallLpips().file();
  const OnnxSignature signature = onnx_signature(file);
  EXPECT_EQ(describe(signature.inputs), "'in0' float32 [?, 3, ?, ?], 'in1' float32 [?, 3, ?, ?]");
  EXPECT_EQ(describe(signature.outputs), "'distance' float32 [?, 1, 1, 1]");
  EXPECT_EQ(describe(std::vector<OnnxValue>{}), "none");
  const std::string fitted = for_opencv(file, {1, 3, 70, 300});
  EXPECT_EQ(describe(onnx_signature(fitted).inputs), "'in0' float32 [1, 3, 70, 300], 'in1' float32 [1, 3, 70, 300]");
  EXPECT_EQ(describe(onnx_signature(fitted).outputs), describe(signature.outputs));
  // An older exporter lists constants among the inputs.
  onnx::Graph listed;
  listed.input("a", {open, 3});
  listed.input("w", {3});
  listed.constant("w", {3}, {1, 2, 3});
  listed.output("d", {});
  listed.node("Mul", {"a", "w"}, "d");
  EXPECT_EQ(describe(onnx_signature(listed.file()).inputs), "'a' float32 [?, 3]");
}

}  // namespace
}  // namespace arah
