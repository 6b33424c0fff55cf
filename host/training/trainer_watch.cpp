// The trainer's watch: what of a step is looked through, what a bad number belongs to, and what becomes of the step.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host/training/loss_slots.h"
#include "host/training/trainer.h"

namespace arah {

void Trainer::watch_pass(uint32_t rays, uint32_t first_of_step, bool position) {
  commands_.stage("watch");
  Watch& watch = room_.watch;
  Field& field = room_.shaded.field();
  const Field::Inputs& at = room_.shaded.inputs();
  const uint32_t rows = room_.samples.rows(rays), shaded = room_.shaded.queue().shaded(), first_sample = room_.samples.rows(first_of_step);
  const BufferSlice canonical = room_.samples.canonical();
  const auto numbers = [](const BufferSlice& slice) { return Matrix{slice, 1, 0}; };
  const auto vectors = [](const BufferSlice& slice) { return Matrix{slice, 4, 0}; };
  watch.record(commands_, Watched::canonical, {.values = vectors(canonical), .rows = rows, .first_row = first_sample, .points = canonical, .after_previous = true});
  watch.record(commands_, Watched::distances, {.values = room_.shaded.composited().sdf, .rows = rows, .first_row = first_sample, .points = canonical});
  if (networks_.spec().color.normal) watch.record(commands_, Watched::sdf_gradients, {.values = field.gradient(), .rows = shaded, .first_row = first_sample, .row_ids = at.samples});
  watch.record(commands_, Watched::colors, {.values = field.rgb(), .rows = shaded, .first_row = first_sample, .row_ids = at.samples});
  watch.record(commands_, Watched::weights, {.values = numbers(room_.shaded.weights()), .rows = rows, .first_row = first_sample});
  watch.record(commands_, Watched::ray_colors, {.values = vectors(room_.shaded.colors()), .rows = rays, .first_row = first_of_step});
  watch.record(commands_, Watched::d_ray_colors, {.values = vectors(room_.d_colors.slice()), .rows = rays, .first_row = first_of_step});
  watch.record(commands_, Watched::d_distances, {.values = field.d_sdf(), .rows = shaded, .first_row = first_sample, .row_ids = at.samples});
  watch.record(commands_, Watched::d_colors, {.values = field.d_rgb(), .rows = shaded, .first_row = first_sample, .row_ids = at.samples});
  if (position) watch.record(commands_, Watched::d_canonical, {.values = vectors(field.position_gradient()), .rows = shaded, .first_row = first_sample, .row_ids = at.samples});
}

std::string Trainer::place_of(WatchedRow row, uint64_t index, const std::vector<std::vector<Batch>>& frames) const {
  if (row == WatchedRow::point) return fmt::format("point {}", index);
  const uint64_t samples = row == WatchedRow::sample ? settings_.color_sampling().samples : 1, of_picture = uint64_t(padded_points(settings_.rays)) * samples;
  const uint64_t picture = index / of_picture, ray = index % of_picture / samples;
  std::string text = row == WatchedRow::sample ? fmt::format("sample {} of ray {}", index % samples, ray) : fmt::format("ray {}", ray);
  for (const std::vector<Batch>& batches : frames)
    for (const Batch& batch : batches)
      if (batch.picture == picture && ray < batch.pixels.size())
        text += fmt::format(", column {}, row {} of camera '{}', frame {}", batch.pixels[ray] & 0xffff, batch.pixels[ray] >> 16, images_.camera(batch.place.camera).name, images_.frame_number(batch.place.frame));
  return text;
}

BadValues Trainer::bad_values(const std::vector<std::vector<Batch>>& frames, const std::vector<float>& losses, const std::vector<PoseGradients>& pose_gradients, bool state) {
  BadValues bad;
  std::vector<BadTensor> later;  // than the losses
  for (const Watch::Seen& seen : room_.watch.seen()) {
    const WatchedTensor& tensor = description(seen.what);
    const uint64_t index = first_place(seen.record), channel = index % tensor.channels;
    const std::string of_row = place_of(tensor.row, index / tensor.channels, frames);
    (seen.what < Watched::d_ray_colors ? bad.tensors : later)
        .push_back({tensor.stage, tensor.tensor, index, tensor.channels > 1 ? fmt::format("channel {} of {}", channel, of_row) : of_row, seen.record.nan, seen.record.infinite, seen.record.beyond, tensor.limit});
  }
  const auto of_host = [](const char* stage, std::string tensor, const std::vector<float>& values, const auto& place) {
    BadTensor found{stage, std::move(tensor), 0, {}, 0, 0, 0, 0};
    for (size_t i = 0; i < values.size(); ++i) {
      if (std::isfinite(values[i])) continue;
      if (found.nan + found.infinite == 0) found.index = i, found.place = place(i);
      found.nan += std::isnan(values[i]);
      found.infinite += std::isinf(values[i]);
    }
    return found;
  };
  const auto add = [&](BadTensor found) {
    if (found.nan + found.infinite) bad.tensors.push_back(std::move(found));
  };
  add(of_host("losses", "losses", losses, [](size_t i) { return fmt::format("the term '{}'", loss_names[i]); }));
  bad.tensors.insert(bad.tensors.end(), later.begin(), later.end());
  for (size_t f = 0; f < pose_gradients.size(); ++f) {
    const int frame = images_.frame_number(frames[f][0].place.frame);
    add(of_host("skinning backward", "gradients of bone transforms", pose_gradients[f].bones, [&](size_t i) { return fmt::format("row {}, column {} of joint {}, frame {}", i % 12 / 4, i % 4, i / 12, frame); }));
    add(of_host("weights", "gradients of the pose that the SDF reads", pose_gradients[f].input, [&](size_t) { return fmt::format("frame {}", frame); }));
  }
  for (BadTensor& gradient : room_.updates.bad_gradients()) bad.tensors.push_back(std::move(gradient));
  const RootFindingCounts& counts = searches_;
  // A skinning network that is not finite shows in this alone where the step does not train it.
  if (state || !bad.tensors.empty() || (counts.points > 0 && counts.converged == 0)) {
    std::vector<BadTensor> of_state = room_.updates.bad_state();
    bad.state = !of_state.empty();
    bad.tensors.insert(bad.tensors.begin(), of_state.begin(), of_state.end());
  }
  if (counts.points) bad.searches = fmt::format("{} of {} found a root, {} went astray, {} did not come to an end", counts.converged, counts.points, counts.diverged, counts.exhausted);
  bad.step = steps_ + 1;
  return bad;
}

StepReport Trainer::skip(BadValues found, uint64_t steps_left) {
  room_.updates.record_skip(commands_);
  commands_.submit_and_wait();
  if (settings_.on_bad_value == OnBadValue::stop || found.state || skipped_in_a_row_ == most_skipped) {
    state_watched_ = false;
    throw BadValueError(std::move(found));
  }
  skipped_ += 1;
  skipped_in_a_row_ += 1;
  steps_ += 1;
  done_ += (1 - done_) / double(std::max<uint64_t>(steps_left, 1));
  StepReport report;
  report.step = steps_;
  report.skipped = skipped_;
  report.bad = std::move(found);
  return report;
}

SafetensorsFile Trainer::failure(const BadValues& found) {
  // An avatar's own tensors are finite, whatever "optimizer.*" holds, which is what training goes on from.
  Avatar shown = avatar();
  for (float& value : shown.parameters)
    if (!std::isfinite(value)) value = 0;
  float& b = shown.tensor("b")[0];
  b = std::max(b, 1e-6f);
  SafetensorsFile file = state(shown);
  put_bad_values(file, found);
  return file;
}

}  // namespace arah
