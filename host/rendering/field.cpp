#include "host/rendering/field.h"

#include <algorithm>
#include <stdexcept>

#include "kernels/color/posed_normals.h"
#include "kernels/color/posed_normals_backward.h"
#include "kernels/compositing/scatter_distances.h"
#include "kernels/skinning/position_gradient.h"
#include "kernels/tracing/compact.h"
#include "kernels/tracing/normalise_inputs.h"
#include "shaders/shared/work_count.h"

namespace arah {

Field::Field(Device& device, AvatarNetworks& networks, uint32_t capacity, uint32_t samples_per_ray, const Shaded& shaded, bool with_gradients, Arithmetic arithmetic)
    : device_(device), networks_(networks), samples_per_ray_(samples_per_ray) {
  const bool normal = networks.spec().color.normal;
  const uint64_t rows = padded_points(shaded.capacity);
  const Element hidden = hidden_element(arithmetic);
  const auto holds = !with_gradients ? normal || shaded.gradient ? SirenTape::Holds::gradient : SirenTape::Holds::values : normal ? SirenTape::Holds::second_order : SirenTape::Holds::first_order;
  distance_tape_.emplace(device, "samples: distances", networks.sdf_shape(), capacity, SirenTape::Holds::values, hidden, false);
  sdf_tape_.emplace(device, "samples: sdf", networks.sdf_shape(), shaded.capacity, holds, hidden);
  color_tape_.emplace(device, "samples: color", networks.color_shape(), shaded.capacity, with_gradients, hidden);
  if (normal) normals_ = Buffer(device, "samples: normals", rows * 16, BufferPlace::device);
  if (!with_gradients) return;
  if (normal) d_normals_ = Buffer(device, "samples: gradient at normals", rows * 16, BufferPlace::device);
  d_position_ = Buffer(device, "samples: gradient at n(x)", rows * 16, BufferPlace::device);
  upstream_ = Buffer(device, "samples: gradient at x", rows * 16, BufferPlace::device);
  const uint64_t floats = std::max({networks.sdf().weight_gradient_scratch(shaded.capacity), networks.color().weight_gradient_scratch(shaded.capacity), networks.unpack_scratch()});
  scratch_ = Buffer(device, "weight gradients: partial sums", floats * 4, BufferPlace::device);
}

void Field::make_room_for_gaps() {
  if (with_point_.bytes()) return;
  const uint32_t capacity = distance_tape_->capacity();
  with_point_ = Buffer(device_, "samples: with a point", capacity * 4ull, BufferPlace::device);
  with_point_count_ = Buffer(device_, "samples: how many with a point", sizeof(WorkCount), BufferPlace::shared);
  compaction_ = Buffer(device_, "samples: compaction", compact_blocks(capacity) * 4ull, BufferPlace::device);
  distances_by_row();
}

void Field::make_room_for_normals() {
  if (!normals_.bytes()) normals_ = Buffer(device_, "samples: normals", shaded_capacity() * 16ull, BufferPlace::device);
}

bool Field::takes_transforms(bool view_rotated) const {
  const ColorSpec& color = networks_.spec().color;
  return color.directions == DirectionSpace::canonical ? color.view : color.normal || (color.view && view_rotated);
}

Matrix Field::record_distances(Commands& commands, const BufferSlice& frame, const BufferSlice& canonical, uint32_t rows, bool sparse) {
  Rows evaluated{{rows, {}}, {}};
  if (sparse) {
    make_room_for_gaps();
    CompactArgs found;
    found.rows.range.points = rows;
    found.flagged_points = canonical;
    found.scratch = compaction_.slice();
    found.compacted = with_point_.slice();
    found.count = with_point_count_.slice();
    record_compact(commands, found);
    commands.submit_and_wait();
    WorkCount count{};
    device_.download(with_point_count_.slice(), &count, sizeof count);
    evaluated = {{count.count, {}}, with_point_.slice()};
  }
  if (evaluated.range.points) {
    record_normalise_inputs(commands, {evaluated, frame, canonical, distance_tape_->input()});
    networks_.sdf().record_forward(commands, *distance_tape_, evaluated.range, false);
  }
  if (!sparse) return distance_tape_->sdf();
  const Matrix result = distances_by_row();
  if (evaluated.range.points) record_scatter_distances(commands, {evaluated.range.points, with_point_.slice(), distance_tape_->sdf(), result.slice});
  return result;
}

Matrix Field::record_distances(Commands& commands, const BufferSlice& canonical, uint32_t rows, const DistanceNodes& baked) {
  const Matrix result = distances_by_row();
  record_interpolate_distances(commands, {rows, canonical, baked, result.slice});
  return result;
}

Matrix Field::opaque_distances() {
  if (!opaque_.bytes()) {
    opaque_ = Buffer(device_, "samples: distances inside", capacity() * 16ull, BufferPlace::device);
    device_.upload(opaque_.slice(), std::vector<float>(capacity() * 4ull, -1.0f));
  }
  return {opaque_.slice(), 4, 0};
}

Matrix Field::distances_by_row() {
  if (!distances_.bytes()) {
    distances_ = Buffer(device_, "samples: distances by row", capacity() * 16ull, BufferPlace::device);
    device_.upload(distances_.slice(), std::vector<float>(capacity() * 4ull, 0.0f));
  }
  return {distances_.slice(), 4, 0};
}

void Field::record_forward(Commands& commands, const Inputs& in, bool want_gradient) {
  const PointRange range{in.rows, {}};
  record_normalise_inputs(commands, {{range, {}}, in.frame, in.canonical, sdf_tape_->input()});
  const bool normal = networks_.spec().color.normal;
  networks_.sdf().record_forward(commands, *sdf_tape_, range, want_gradient || normal || networks_.has_gradients());  // with gradients also for `rotated`
  AssembleInputsArgs rows;
  rows.row = networks_.color_row();
  const bool rotated = rows.row.view && in.view_rotation;
  if (want_gradient || normal || rotated) networks_.sdf().record_gradient(commands, *sdf_tape_, range, normal && networks_.has_gradients());
  if (takes_transforms(rotated) && in.transforms.empty()) throw std::invalid_argument("the colour takes normals or canonical views: the field needs the samples' transforms");
  if (normal || rotated) {
    make_room_for_normals();
    record_posed_normals(commands, {in.rows, sdf_tape_->gradient(), rows.row.canonical ? BufferSlice{} : in.transforms, normals_.slice(), false});
    rows.normals = normals_.slice();
  }
  if (rotated) rows.view_rotation = in.view_rotation;
  rows.transforms = in.transforms;
  rows.points = in.rows;
  rows.samples_per_ray = samples_per_ray_;
  rows.frame = in.frame;
  rows.canonical = in.canonical;
  rows.rays = in.rays;
  if (rows.row.feature_channels) rows.feature = sdf_tape_->feature();
  rows.rows = color_tape_->input();
  rows.channels = rows.row.grid_column() + networks_.grid().channels();
  rows.samples = in.samples;
  rows.sample_count = in.sample_count;
  record_assemble_inputs(commands, rows);
  if (networks_.grid().levels) {
    FeatureGridForwardArgs grid;
    grid.shape = networks_.grid();
    grid.points = in.rows;
    grid.positions = in.canonical;
    grid.features = networks_.parameters().elements(networks_.layout().slot("grid.0").offset, networks_.grid().feature_count());
    grid.rows = color_tape_->input();
    grid.first_column = rows.row.grid_column();
    record_feature_grid_forward(commands, grid);
  }
  networks_.color().record_forward(commands, *color_tape_, range);
}

void Field::record_clear_cotangents(Commands& commands, uint32_t first) {
  const uint32_t end = padded_points(std::max(first, 1u));
  for (const Matrix& matrix : {d_sdf(), d_rgb()}) commands.fill(matrix.slice.elements(uint64_t(first) * matrix.stride, uint64_t(end - first) * matrix.stride), 0);
}

void Field::record_backward(Commands& commands, const Inputs& in, const Backward& options) {
  const PointRange range{in.rows, {}};
  DenseNetwork::Backward color;
  color.input_gradient = true;
  color.accumulate = options.accumulate;
  color.scratch = scratch_.slice();
  networks_.color().record_backward(commands, *color_tape_, range, color);

  AssembleInputsBackwardArgs rows;
  rows.row = networks_.color_row();
  rows.points = in.rows;
  rows.d_rows = color_tape_->input_gradient();
  rows.d_position = d_position_.slice();
  if (rows.row.feature_channels) rows.d_feature = sdf_tape_->feature_cotangent();
  if (rows.row.normal) rows.d_normal = d_normals_.slice();
  record_assemble_inputs_backward(commands, rows);
  if (rows.row.normal) record_posed_normals_backward(commands, {in.rows, d_normals_.slice(), rows.row.canonical ? BufferSlice{} : in.transforms, sdf_tape_->gradient_cotangent()});
  if (networks_.grid().levels) {
    FeatureGridBackwardArgs grid;
    grid.shape = networks_.grid();
    grid.points = in.rows;
    grid.max_contributions = in.rows;
    grid.scale = options.grid_scale;
    grid.positions = in.canonical;
    grid.features = networks_.parameters().elements(networks_.layout().slot("grid.0").offset, networks_.grid().feature_count());
    grid.d_rows = color_tape_->input_gradient();
    grid.first_column = rows.row.grid_column();
    grid.sums = options.grid_sums;
    grid.clamped = options.grid_clamped;
    if (options.position) {
      grid.position_gradient = PositionGradient::add;
      grid.d_position = d_position_.slice();
      grid.position_factor = static_cast<float>(networks_.cube().metres_per_unit());  // per metre → per cube unit
    }
    record_feature_grid_backward(commands, grid);
  }

  Siren::Backward sdf;
  sdf.feature = rows.row.feature_channels > 0;
  sdf.gradient = rows.row.normal;
  sdf.accumulate = options.accumulate;
  sdf.input_gradient = options.position;
  sdf.scratch = scratch_.slice();
  networks_.sdf().record_backward(commands, *sdf_tape_, range, sdf);
  if (options.position) record_position_gradient(commands, {in.rows, in.frame, sdf_tape_->input_gradient(), d_position_.slice(), upstream_.slice()});
}

void Field::record_gradient(Commands& commands, const Inputs& in) { networks_.sdf().record_gradient(commands, *sdf_tape_, {in.rows, {}}, false); }

void Field::record_backward_from_distances(Commands& commands, const Inputs& in) {
  Siren::Backward sdf;
  sdf.accumulate = true;
  sdf.scratch = scratch_.slice();
  networks_.sdf().record_backward(commands, *sdf_tape_, {in.rows, {}}, sdf);
}

}  // namespace arah
