#include "kernels/color/assemble_inputs.h"

#include <fmt/format.h>

#include <stdexcept>

#include "shaders/shared/frame.h"
#include "shaders/shared/ray.h"

namespace arah {
namespace {

constexpr uint32_t group = 8;           // floats stored at once
constexpr uint32_t groups_a_block = 4;  // GROUPS_A_BLOCK of lib/color_row.glsl
constexpr uint32_t points_a_workgroup = 64;

uint32_t divided_up(uint32_t value, uint32_t by) {
  return (value + by - 1) / by;
}

std::vector<uint32_t> specialization(const ColorRow& row) {
  return {row.view, row.normal, row.feature_channels};
}

uint64_t matrix_bytes(const Matrix& matrix, uint32_t points) {
  return uint64_t(padded_points(points)) * matrix.stride * 4;
}

void check_width(const char* what, const Matrix& matrix, uint32_t channels) {
  if (matrix.column % channel_padding != 0 || matrix.stride % channel_padding != 0 ||
      matrix.column + padded_channels(channels) > matrix.stride) {
    throw std::invalid_argument(fmt::format("colour inputs: {} has stride {} and column {}; {} channels do not fit",
                                            what, matrix.stride, matrix.column, channels));
  }
}

}  // namespace

void record_assemble_inputs(Commands& commands, const AssembleInputsArgs& args) {
  const ColorRow& row = args.row;
  if (args.channels < row.grid_column())
    throw std::invalid_argument(
        fmt::format("colour inputs: {} channels asked for, the parts need {}", args.channels, row.grid_column()));
  if (args.samples_per_ray == 0) throw std::invalid_argument("colour inputs: 0 samples a ray");
  check_width("rows", args.rows, args.channels);
  if (row.feature_channels > 0) check_width("feature", args.feature, row.feature_channels);

  struct {
    uint32_t samples_per_ray, row_stride, row_column, row_groups, feature_stride, feature_column;
    std::array<float, 9> view_rotation;
  } const constants{args.samples_per_ray,     args.rows.stride / group,
                    args.rows.column / group, padded_channels(args.channels) / group,
                    args.feature.stride / 4,  args.feature.column / 4,
                    args.view_rotation.value_or(std::array<float, 9>{})};
  const uint32_t points = padded_points(args.points);
  const uint32_t head_groups = divided_up(row.feature_column(), group);
  const bool indexed = !args.samples.empty();
  const bool turned = row.view && row.canonical, rotated = row.view && args.view_rotation, normals = row.normal || rotated;
  const uint32_t rays = padded_points(divided_up(indexed ? args.sample_count : args.points, args.samples_per_ray));

  std::vector<uint32_t> constant_words = specialization(row);
  constant_words.insert(constant_words.end(), {indexed, turned, rotated});
  Launch launch;
  launch.pipeline = &commands.device().pipeline("color/assemble_inputs", constant_words);
  launch.name = "colour inputs";
  launch.groups = {points / points_a_workgroup, 1 + divided_up(constants.row_groups - head_groups, groups_a_block), 1};
  launch.bindings = {{args.frame, sizeof(FrameConstants)},
                     {args.canonical, points * uint64_t(16)},
                     row.view ? Binding{args.rays, rays * sizeof(Ray)} : Binding{args.canonical},
                     normals ? Binding{args.normals, points * uint64_t(16)} : Binding{args.canonical},
                     row.feature_channels > 0 ? Binding{args.feature.slice, matrix_bytes(args.feature, args.points)}
                                              : Binding{args.canonical},
                     {args.rows.slice, matrix_bytes(args.rows, args.points)},
                     indexed ? Binding{args.samples, points * uint64_t(4)} : Binding{args.canonical},
                     turned ? Binding{args.transforms, points * uint64_t(48)} : Binding{args.canonical}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {
      0, 4.0 * points * (4 + 4 * row.view + 4 * normals + 12 * turned + row.feature_channels + padded_channels(args.channels))};
  commands.dispatch(launch);
}

void record_assemble_inputs_backward(Commands& commands, const AssembleInputsBackwardArgs& args) {
  const ColorRow& row = args.row;
  check_width("d_rows", args.d_rows, row.grid_column());
  if (row.feature_channels > 0) check_width("d_feature", args.d_feature, row.feature_channels);

  struct {
    uint32_t row_stride, row_column, feature_stride, feature_column;
  } const constants{args.d_rows.stride / 4, args.d_rows.column / 4, args.d_feature.stride / group,
                    args.d_feature.column / group};
  const uint32_t points = padded_points(args.points);

  Launch launch;
  launch.pipeline = &commands.device().pipeline("color/assemble_inputs_backward", specialization(row));
  launch.name = "colour inputs backward";
  launch.groups = {points / points_a_workgroup, 1 + divided_up(divided_up(row.feature_channels, group), groups_a_block),
                   1};
  launch.bindings = {{args.d_rows.slice, matrix_bytes(args.d_rows, args.points)},
                     {args.d_position, points * uint64_t(16)},
                     row.normal ? Binding{args.d_normal, points * uint64_t(16)} : Binding{args.d_position},
                     row.feature_channels > 0 ? Binding{args.d_feature.slice, matrix_bytes(args.d_feature, args.points)}
                                              : Binding{args.d_position}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof(constants);
  launch.cost = {0, 4.0 * points * (row.grid_column() + 4 + 4 * row.normal + padded_channels(row.feature_channels))};
  commands.dispatch(launch);
}

}  // namespace arah
