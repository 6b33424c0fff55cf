// Where tensors lie and how they start: shapes against golden tensors, alignment, distributions, the grid's extent.
#include "host/avatar/parameter_layout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <span>

#include "host/avatar/grid_extent.h"
#include "tests/golden.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

using ::testing::ElementsAre;

const std::vector<int> kSmplParents{-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21};

Skeleton tree(std::vector<int> parents) {
  Skeleton skeleton = chain_skeleton(static_cast<int>(parents.size()));
  skeleton.parents = std::move(parents);
  return skeleton;
}

// A spec with every part, in odd sizes.
AvatarSpec odd_spec() {
  AvatarSpec spec;
  spec.skinning = {Skinning::network, 17, 3};
  spec.sdf = {13, 3, 25.0, SdfConditioning::latent, 9, 2, PoseConditioning::low_rank, 16, 2};
  spec.color = {21, 4, 3, 7, true, true, true, true};
  spec.latent_size = 5;
  spec.latent_init_std = 0.25;
  spec.grid_cells = {0.11, 0.05};
  return spec;
}

GridExtent odd_grid() {
  return {{-1, -1, -1}, {1, 1, 1}, {{3, 5, 2}, {7, 9, 3}}};
}

std::span<const float> slice(const std::vector<float>& values, const TensorSlot& slot) {
  return std::span(values).subspan(slot.offset, slot.count);
}

TEST(ParameterLayout, PaperSizesMatchTheGoldenTensors) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const ParameterLayout layout = make_parameter_layout(preset_spec("paper"), tree(kSmplParents), 4, {});
  std::size_t compared = 0;
  const auto compare = [&](const char* file, const std::string& theirs, const std::string& ours) {
    const golden::Case data(file);
    for (const auto& [name, tensor] : data.file().tensors) {
      if (!name.starts_with("param." + theirs) || name.ends_with("eta") || name.ends_with("gamma")) continue;
      const std::string slot = ours + name.substr(6 + theirs.size());
      ASSERT_TRUE(layout.has(slot)) << slot;
      EXPECT_EQ(layout.slot(slot).shape, tensor.shape) << slot;
      ++compared;
    }
  };
  compare("04_siren_full_params", "sdf.", "sdf.");
  compare("03_lbs_net", "lbs.", "skinning.");
  compare("06_colour_params", "col.", "color.");
  EXPECT_EQ(compared, 7u * 2 + 5 * 3 + 6 * 3);
}

// ARAH.md section 11 counts 85.60 million numbers, 84.54 of them in the last layers, and 13,734 of the encoder. The bias of the
// last layers, 330,241 numbers, is here the SDF that all poses share.
TEST(ParameterLayout, PaperHypernetworkHasTheReleasedNumbers) {
  const ParameterLayout layout = make_parameter_layout(preset_spec("paper"), tree(kSmplParents), 4, {});
  EXPECT_EQ(layout.parameter_count("hyper_last"), 84541696u);
  EXPECT_EQ(layout.parameter_count("sdf"), 330241u);
  EXPECT_EQ(layout.parameter_count("sdf") + layout.parameter_count("hyper") + layout.parameter_count("hyper_last"), 85599489u);
  EXPECT_EQ(layout.parameter_count("pose_code"), 13734u);
  EXPECT_EQ(layout.group("hyper_last").end, layout.floats) << "gradients end before it";
  EXPECT_EQ(layout.slot("hyper_last.1.W").shape, (std::vector<int64_t>{65536, 256}));
}

TEST(ParameterLayout, GroupsFollowEachOtherAndSlotsAreAligned) {
  for (const AvatarSpec& spec : {odd_spec(), preset_spec("paper")}) {
    const ParameterLayout layout =
        make_parameter_layout(spec, tree(kSmplParents), 3, spec.grid_cells.empty() ? GridExtent{} : odd_grid());
    std::vector<std::string> names;
    uint64_t end = 0;
    for (const ParameterGroup& group : layout.groups) {
      names.push_back(group.name);
      EXPECT_EQ(group.begin, end) << group.name;
      EXPECT_EQ(group.begin % kSlotAlignment, 0u);
      EXPECT_GE(group.end, group.begin);
      end = group.end;
    }
    EXPECT_EQ(layout.floats, end);
    EXPECT_EQ(end % kSlotAlignment, 0u);
    EXPECT_THAT(names, ElementsAre("sdf", "mapping", "skinning", "color", "latent", "deviation", "pose_code", "hyper", "low_rank", "grid", "hyper_last"));
    end = 0;
    for (const TensorSlot& slot : layout.slots) {
      EXPECT_GE(slot.offset, end) << slot.name;
      EXPECT_LT(slot.offset - end, kSlotAlignment) << slot.name;
      EXPECT_EQ(slot.offset % (slot.name == "grid.1" ? 4 : kSlotAlignment), 0u) << slot.name;
      const int64_t count = std::accumulate(slot.shape.begin(), slot.shape.end(), int64_t{1}, std::multiplies<>());
      EXPECT_EQ(slot.count, static_cast<uint64_t>(count)) << slot.name;
      end = slot.offset + slot.count;
    }
    EXPECT_LE(end, layout.floats);
    uint64_t sum = 0;
    for (const ParameterGroup& group : layout.groups) sum += layout.parameter_count(group.name);
    EXPECT_EQ(sum, layout.parameter_count());
  }
}

TEST(ParameterLayout, GridLevelsFollowWithoutGap) {
  const ParameterLayout layout = make_parameter_layout(odd_spec(), tree({-1, 0}), 2, odd_grid());
  EXPECT_THAT(layout.slot("grid.0").shape, ElementsAre(2, 5, 3, 4));
  EXPECT_THAT(layout.slot("grid.1").shape, ElementsAre(3, 9, 7, 4));
  EXPECT_EQ(layout.slot("grid.1").offset, layout.slot("grid.0").offset + 2 * 5 * 3 * 4);
}

TEST(ParameterLayout, SkipWidensOneLayerOnly) {
  const AvatarSpec spec = odd_spec();
  const ParameterLayout layout = make_parameter_layout(spec, tree({-1, 0}), 2, odd_grid());
  const int64_t input = 3 + 27 + 3 + 13 + 8 + 5;
  EXPECT_THAT(layout.slot("color.0.v").shape, ElementsAre(21, input));
  EXPECT_THAT(layout.slot("color.2.v").shape, ElementsAre(7, 21));
  EXPECT_THAT(layout.slot("color.3.v").shape, ElementsAre(21, input + 7));
  EXPECT_THAT(layout.slot("color.4.v").shape, ElementsAre(3, 21));
  EXPECT_FALSE(layout.has("color.5.v"));
}

TEST(ParameterLayout, AbsentPartsCostNothing) {
  AvatarSpec spec = preset_spec("tiny");
  spec.skinning = {Skinning::none, 0, 0};
  spec.color.latent = false;
  spec.latent_size = 0;
  spec.grid_cells.clear();
  const ParameterLayout layout = make_parameter_layout(spec, tree({-1, 0}), 0, {});
  for (const char* group : {"mapping", "skinning", "latent", "pose_code", "hyper", "low_rank", "grid", "hyper_last"})
    EXPECT_EQ(layout.group(group).size(), 0u) << group;
  EXPECT_THROW(layout.slot("latent"), std::out_of_range);
  EXPECT_THROW(layout.group("hair"), std::out_of_range);
}

TEST(ParameterLayout, RefusesLatentCodesWithoutFramesAndGridsOfOtherLevels) {
  EXPECT_THROW(make_parameter_layout(odd_spec(), tree({-1}), 0, odd_grid()), std::invalid_argument);
  EXPECT_THROW(make_parameter_layout(odd_spec(), tree({-1}), 1, {}), std::invalid_argument);
}

TEST(ParameterLayout, LogitsCountJointsAndFurtherSplits) {
  EXPECT_EQ(skinning_logit_count(tree(kSmplParents)), 25u);
  EXPECT_EQ(skinning_logit_count(tree({-1})), 1u);
  EXPECT_EQ(skinning_logit_count(tree({-1, 0, 1, 2})), 4u);
  EXPECT_EQ(skinning_logit_count(tree({-1, 0, 0, 0})), 4u);        // the root's split uses its own slot
  EXPECT_EQ(skinning_logit_count(tree({-1, 0, 1, 1, 3, 3})), 8u);  // two further splits
}

TEST(InitialParameters, FollowTheirDistributions) {
  const AvatarSpec spec = preset_spec("paper");
  const ParameterLayout layout = make_parameter_layout(spec, tree(kSmplParents), 40, {});
  const std::vector<float> values = initial_parameters(spec, layout, 11);
  ASSERT_EQ(values.size(), layout.floats);
  // Uniform in ±bound: inside, nearly reaching both ends, with the second moment bound²/3.
  const auto uniform = [&](const std::string& name, double bound) {
    double least = 0, most = 0, square = 0;
    const auto tensor = slice(values, layout.slot(name));
    for (float value : tensor) {
      const double x = static_cast<double>(value);
      least = std::min(least, x);
      most = std::max(most, x);
      square += x * x / static_cast<double>(tensor.size());
    }
    EXPECT_GE(least, -bound * (1 + 1e-6)) << name;
    EXPECT_LE(most, bound * (1 + 1e-6)) << name;
    EXPECT_LT(least, -0.9 * bound) << name;
    EXPECT_GT(most, 0.9 * bound) << name;
    EXPECT_NEAR(square / (bound * bound / 3), 1.0, 6.0 / std::sqrt(static_cast<double>(tensor.size()))) << name;
  };
  const auto normal = [&](const std::string& name, double deviation) {
    double sum = 0, square = 0, fourth = 0;
    const auto tensor = slice(values, layout.slot(name));
    const double n = static_cast<double>(tensor.size());
    for (float value : tensor) {
      const double x = static_cast<double>(value) / deviation;
      sum += x / n;
      square += x * x / n;
      fourth += x * x * x * x / n;
    }
    EXPECT_NEAR(sum, 0.0, 5.0 / std::sqrt(n)) << name;
    EXPECT_NEAR(square, 1.0, 5.0 * std::sqrt(2.0 / n)) << name;
    EXPECT_NEAR(fourth, 3.0, 5.0 * std::sqrt(96.0 / n)) << name;
  };
  uniform("sdf.0.W", 1.0 / 3.0);
  uniform("sdf.3.W", std::sqrt(6.0 / 256) / 30.0);
  uniform("sdf.6.W", std::sqrt(6.0 / 256) / 30.0);
  uniform("sdf.2.b", 1.0 / 16.0);
  uniform("skinning.1.v", 1.0 / std::sqrt(128.0));
  uniform("color.3.v", 1.0 / std::sqrt(545.0));
  uniform("color.0.b", 1.0 / std::sqrt(417.0));
  normal("mapping.1.W", std::sqrt(2.0 / (1.04 * 256)));
  uniform("mapping.1.b", 1.0 / 16.0);
  normal("latent", 1.0);
  for (float value : slice(values, layout.slot("mapping.3.W"))) ASSERT_EQ(value, 0.0f);
  const auto bias = slice(values, layout.slot("mapping.3.b"));
  for (std::size_t i = 0; i < bias.size(); ++i) ASSERT_EQ(bias[i], i < 6 * 256 ? 1.0f : 0.0f) << i;
  EXPECT_EQ(slice(values, layout.slot("b"))[0], 1e-3f);
}

TEST(InitialParameters, MagnitudesAreRowLengthsAndPaddingIsZero) {
  const AvatarSpec spec = odd_spec();
  const ParameterLayout layout = make_parameter_layout(spec, tree({-1, 0, 0}), 3, odd_grid());
  const std::vector<float> values = initial_parameters(spec, layout, 3);
  for (const std::string layer : {"skinning.0", "skinning.3", "color.0", "color.3"}) {
    const TensorSlot& v = layout.slot(layer + ".v");
    const auto g = slice(values, layout.slot(layer + ".g"));
    for (std::size_t row = 0; row < g.size(); ++row) {
      double square = 0;
      for (int64_t column = 0; column < v.shape[1]; ++column) {
        square +=
            std::pow(static_cast<double>(slice(
                         values, v)[row * static_cast<std::size_t>(v.shape[1]) + static_cast<std::size_t>(column)]),
                     2);
      }
      EXPECT_NEAR(static_cast<double>(g[row]), std::sqrt(square), 1e-7 * std::sqrt(square)) << layer << " row " << row;
    }
  }
  std::vector<bool> used(values.size(), false);
  for (const TensorSlot& slot : layout.slots)
    std::fill_n(used.begin() + static_cast<long>(slot.offset), slot.count, true);
  std::size_t padding = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (used[i]) continue;
    ASSERT_EQ(values[i], 0.0f) << i;
    ++padding;
  }
  EXPECT_GT(padding, 0u);
}

TEST(InitialParameters, DependOnTheSeedAndOnTheirOwnTensorOnly) {
  const AvatarSpec spec = odd_spec();
  const ParameterLayout layout = make_parameter_layout(spec, tree({-1, 0}), 3, odd_grid());
  const std::vector<float> values = initial_parameters(spec, layout, 5);
  EXPECT_EQ(values, initial_parameters(spec, layout, 5));
  EXPECT_NE(values, initial_parameters(spec, layout, 6));
  EXPECT_NE(values, initial_parameters(spec, layout, 5 + (uint64_t{1} << 32)));
  // Another skinning part leaves the SDF's start as it was.
  AvatarSpec other = spec;
  other.skinning.width = 40;
  const ParameterLayout other_layout = make_parameter_layout(other, tree({-1, 0}), 3, odd_grid());
  const std::vector<float> other_values = initial_parameters(other, other_layout, 5);
  for (const char* name : {"sdf.1.W", "mapping.0.W", "color.2.v", "grid.1"}) {
    const auto a = slice(values, layout.slot(name)), b = slice(other_values, other_layout.slot(name));
    EXPECT_TRUE(std::equal(a.begin(), a.end(), b.begin(), b.end())) << name;
  }
}

TEST(GridExtent, CoversTheBodyWithItsMarginInWholeCells) {
  AvatarSpec spec = odd_spec();
  spec.grid_cells = {0.04, 0.02, 0.03};
  const std::vector<glm::dvec3> vertices{{-0.5, 0.0, -0.1}, {0.53, 1.75, 0.2}, {0.1, 1.0, 0.0}};
  const GridExtent grid = make_grid_extent(spec, vertices);
  ASSERT_EQ(grid.nodes.size(), 3u);
  for (int axis = 0; axis < 3; ++axis) {
    const double lower = static_cast<double>(grid.lower[axis]), upper = static_cast<double>(grid.upper[axis]);
    EXPECT_LE(lower, vertices[0][axis] - 0.12 + 1e-6);
    EXPECT_GE(upper, vertices[1][axis] + 0.12 - 1e-6);
    EXPECT_LT(upper - lower, vertices[1][axis] - vertices[0][axis] + 2 * 0.12 + 0.04);
    for (std::size_t level = 0; level < 3; ++level) {
      const double cell = (upper - lower) / static_cast<double>(grid.nodes[level][axis] - 1);
      EXPECT_LE(cell, spec.grid_cells[level] * (1 + 1e-5)) << level;
      EXPECT_GT(cell, spec.grid_cells[level] * 0.85) << level;
    }
    EXPECT_EQ(grid.nodes[1][axis] - 1, 2 * (grid.nodes[0][axis] - 1));
  }
  spec.grid_cells.clear();
  EXPECT_EQ(make_grid_extent(spec, vertices), GridExtent{});
}

TEST(GridExtent, RefusesAGridBeyondADevicesBuffer) {
  AvatarSpec spec = odd_spec();
  spec.grid_cells = {0.02};
  const std::vector<glm::dvec3> giant{{0, 0, 0}, {300, 1000, 200}};
  expect_input_error([&] { make_grid_extent(spec, giant); }, {"feature grid", "0.02", "128 MiB", "larger cells"});
}

}  // namespace
}  // namespace arah
