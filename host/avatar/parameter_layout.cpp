#include "host/avatar/parameter_layout.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <stdexcept>

namespace arah {
namespace {

uint64_t aligned(uint64_t floats) {
  return (floats + kSlotAlignment - 1) / kSlotAlignment * kSlotAlignment;
}

class LayoutBuilder {
 public:
  void add(std::string name, std::vector<int64_t> shape) {
    uint64_t count = 1;
    for (int64_t extent : shape) count *= static_cast<uint64_t>(extent);
    layout_.slots.push_back({std::move(name), std::move(shape), next_, count});
    next_ += count;
  }

  // The next tensor starts on an aligned offset.
  void align() { next_ = aligned(next_); }

  // widths as color_widths() and its like give them; `skip` as in ColorSpec.
  void add_network(const std::string& name, const std::vector<uint32_t>& widths, bool weight_norm, int skip = -1) {
    for (std::size_t i = 0; i + 1 < widths.size(); ++i) {
      const int64_t outputs = widths[i + 1];
      const int64_t inputs = int64_t{widths[i]} + (static_cast<int>(i) == skip ? int64_t{widths[0]} : 0);
      const std::string layer = fmt::format("{}.{}", name, i);
      add(layer + (weight_norm ? ".v" : ".W"), {outputs, inputs});
      align();
      if (weight_norm) {
        add(layer + ".g", {outputs});
        align();
      }
      add(layer + ".b", {outputs});
      align();
    }
  }

  void group(const char* name, const std::function<void()>& add_tensors) {
    align();
    const uint64_t begin = next_;
    add_tensors();
    align();
    layout_.groups.push_back({name, begin, next_});
  }

  ParameterLayout take() {
    layout_.floats = next_;
    return std::move(layout_);
  }

 private:
  ParameterLayout layout_;
  uint64_t next_ = 0;
};

}  // namespace

bool ParameterLayout::has(const std::string& name) const {
  return std::any_of(slots.begin(), slots.end(), [&](const TensorSlot& slot) { return slot.name == name; });
}

const TensorSlot& ParameterLayout::slot(const std::string& name) const {
  const auto found =
      std::find_if(slots.begin(), slots.end(), [&](const TensorSlot& slot) { return slot.name == name; });
  if (found == slots.end()) throw std::out_of_range("the avatar has no tensor \"" + name + "\"");
  return *found;
}

const ParameterGroup& ParameterLayout::group(const std::string& name) const {
  const auto found =
      std::find_if(groups.begin(), groups.end(), [&](const ParameterGroup& group) { return group.name == name; });
  if (found == groups.end()) throw std::out_of_range("there is no parameter group \"" + name + "\"");
  return *found;
}

uint64_t ParameterLayout::parameter_count() const {
  uint64_t sum = 0;
  for (const TensorSlot& slot : slots) sum += slot.count;
  return sum;
}

uint64_t ParameterLayout::parameter_count(const std::string& group_name) const {
  const ParameterGroup& range = group(group_name);
  uint64_t sum = 0;
  for (const TensorSlot& slot : slots) {
    if (slot.offset >= range.begin && slot.offset < range.end) sum += slot.count;
  }
  return sum;
}

uint32_t skinning_logit_count(const Skeleton& skeleton) {
  std::vector<uint32_t> children(skeleton.size(), 0);
  for (int parent : skeleton.parents) {
    if (parent >= 0) ++children[static_cast<std::size_t>(parent)];
  }
  const auto further = std::count_if(children.begin() + 1, children.end(), [](uint32_t count) { return count > 1; });
  return static_cast<uint32_t>(skeleton.size()) + static_cast<uint32_t>(further);
}

ParameterLayout make_parameter_layout(const AvatarSpec& spec, const Skeleton& skeleton, std::size_t latent_frames,
                                      const GridExtent& grid) {
  if (spec.latent_size > 0 && latent_frames == 0) {
    throw std::invalid_argument("latent codes need at least one frame");
  }
  if (grid.nodes.size() != spec.grid_cells.size()) {
    throw std::invalid_argument(
        fmt::format("{} grid levels for a spec with {}", grid.nodes.size(), spec.grid_cells.size()));
  }
  LayoutBuilder builder;
  builder.group("sdf", [&] { builder.add_network("sdf", sdf_widths(spec), false); });
  builder.group("mapping", [&] { builder.add_network("mapping", mapping_widths(spec), false); });
  builder.group("skinning",
                [&] { builder.add_network("skinning", skinning_widths(spec, skinning_logit_count(skeleton), static_cast<uint32_t>(skeleton.size())), true); });
  builder.group("color", [&] { builder.add_network("color", color_widths(spec), true, spec.color.skip); });
  builder.group("latent", [&] {
    if (spec.latent_size > 0) builder.add("latent", {static_cast<int64_t>(latent_frames), int64_t{spec.latent_size}});
  });
  builder.group("deviation", [&] { builder.add("b", {1}); });
  const bool posed = spec.sdf.pose != PoseConditioning::none;
  const auto joints = static_cast<int64_t>(skeleton.size());
  const std::vector<uint32_t> sdf = sdf_widths(spec), pose = pose_widths(spec, static_cast<uint32_t>(joints));
  const auto add = [&](const std::string& name, std::vector<int64_t> shape) {
    builder.add(name, std::move(shape));
    builder.align();
  };
  builder.group("pose_code", [&] {
    if (!posed) return;
    const int64_t features = kPoseFeatures, hidden = kPoseHidden;
    add("pose_code.global.W", {features, kPoseChannels * joints});
    add("pose_code.global.b", {features});
    add("pose_code.1.W", {joints, hidden, hidden});
    add("pose_code.1.b", {joints, hidden});
    add("pose_code.2.W", {joints, features, hidden});
    add("pose_code.2.b", {joints, features});
  });
  builder.group("hyper", [&] {
    for (std::size_t i = 0; i + 1 < pose.size(); ++i) {
      const auto layers = static_cast<int64_t>(sdf.size() - 1);
      const std::string name = fmt::format("hyper.{}.", i);
      add(name + "W", {layers, int64_t{pose[i + 1]}, int64_t{pose[i]}});
      for (const char* part : {"b", "scale", "shift"}) add(name + part, {layers, int64_t{pose[i + 1]}});
    }
  });
  const int64_t rank = spec.sdf.pose_width;
  builder.group("low_rank", [&] {
    if (spec.sdf.pose != PoseConditioning::low_rank) return;
    for (std::size_t l = 0; l + 1 < sdf.size(); ++l) {
      const std::string name = fmt::format("low_rank.{}.", l);
      add(name + "U", {int64_t{sdf[l + 1]}, rank});
      add(name + "V", {rank, int64_t{sdf[l]}});
      add(name + "C", {int64_t{sdf[l + 1]}, rank});
    }
  });
  builder.group("grid", [&] {
    for (std::size_t i = 0; i < grid.nodes.size(); ++i) {
      const glm::uvec3& nodes = grid.nodes[i];
      builder.add(fmt::format("grid.{}", i),
                  {int64_t{nodes.z}, int64_t{nodes.y}, int64_t{nodes.x}, int64_t{kGridFeatures}});
    }
  });
  builder.group("hyper_last", [&] {
    if (spec.sdf.pose != PoseConditioning::hypernetwork) return;
    for (std::size_t l = 0; l + 1 < sdf.size(); ++l) {
      add(fmt::format("hyper_last.{}.W", l), {int64_t{sdf[l + 1]} * sdf[l], rank});
      add(fmt::format("hyper_last.{}.b", l), {int64_t{sdf[l + 1]}, rank});
    }
  });
  return builder.take();
}

}  // namespace arah
