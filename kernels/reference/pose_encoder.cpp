#include "kernels/reference/pose_encoder.h"

#include <cmath>

#include "kernels/reference/sizes.h"

namespace arah::reference {
namespace {

void check(const PoseEncoder& e, std::span<const double> rotations, std::span<const double> positions) {
  const std::size_t n = e.joints();
  check_size("pose encoder: rotations", rotations.size(), 9 * n);
  check_size("pose encoder: positions", positions.size(), 3 * n);
  check_size("pose encoder: global W", e.global_w.size(), kPoseFeatures * kPoseChannels * n);
  check_size("pose encoder: W1", e.w1.size(), n * kPoseHidden * kPoseHidden);
  check_size("pose encoder: W2", e.w2.size(), n * kPoseFeatures * kPoseHidden);
}

}  // namespace

PoseEncoder PoseEncoder::zeros() const {
  const auto same = [](const std::vector<double>& v) { return std::vector<double>(v.size(), 0.0); };
  return {parents, same(global_w), same(global_b), same(w1), same(b1), same(w2), same(b2)};
}

PoseEncoderTape pose_encoder_forward(const PoseEncoder& e, std::span<const double> rotations,
                                     std::span<const double> positions) {
  check(e, rotations, positions);
  const std::size_t n = e.joints();
  PoseEncoderTape tape;
  std::vector<double> global(kPoseFeatures);
  for (std::size_t f = 0; f < kPoseFeatures; ++f) {
    const double* row = &e.global_w[f * kPoseChannels * n];
    global[f] = e.global_b[f];
    for (std::size_t i = 0; i < 9 * n; ++i) global[f] += row[i] * rotations[i];
    for (std::size_t i = 0; i < 3 * n; ++i) global[f] += row[9 * n + i] * positions[i];
  }
  for (std::size_t j = 0; j < n; ++j) {
    const bool root = e.parents[j] < 0;
    const auto parent = static_cast<std::size_t>(root ? 0 : e.parents[j]);
    std::vector<double> in(&rotations[9 * j], &rotations[9 * j] + 9);
    double squares = 0;
    for (std::size_t a = 0; a < 3; ++a) {
      in.push_back(positions[3 * j + a]);
      const double bone = positions[3 * j + a] - (root ? 0 : positions[3 * parent + a]);
      squares += bone * bone;
    }
    in.push_back(std::sqrt(squares));
    for (std::size_t f = 0; f < kPoseFeatures; ++f)
      in.push_back(root ? global[f] : tape.code[kPoseFeatures * parent + f]);
    std::vector<double> hidden(kPoseHidden);
    for (std::size_t h = 0; h < kPoseHidden; ++h) {
      double sum = e.b1[kPoseHidden * j + h];
      for (std::size_t i = 0; i < kPoseHidden; ++i) sum += e.w1[(kPoseHidden * j + h) * kPoseHidden + i] * in[i];
      hidden[h] = sum > 0 ? sum : 0;
    }
    for (std::size_t f = 0; f < kPoseFeatures; ++f) {
      double sum = e.b2[kPoseFeatures * j + f];
      for (std::size_t h = 0; h < kPoseHidden; ++h) sum += e.w2[(kPoseFeatures * j + f) * kPoseHidden + h] * hidden[h];
      tape.code.push_back(sum);
    }
    tape.inputs.insert(tape.inputs.end(), in.begin(), in.end());
    tape.hidden.insert(tape.hidden.end(), hidden.begin(), hidden.end());
  }
  return tape;
}

PoseGradient pose_encoder_backward(const PoseEncoder& e, std::span<const double> rotations,
                                   std::span<const double> positions, const PoseEncoderTape& tape,
                                   std::span<const double> d_code, PoseEncoder* gradients) {
  check(e, rotations, positions);
  const std::size_t n = e.joints();
  check_size("pose encoder backward: code", d_code.size(), kPoseFeatures * n);
  PoseEncoder unused;
  if (gradients == nullptr) {
    unused = e.zeros();
    gradients = &unused;
  }
  PoseGradient result{std::vector<double>(9 * n, 0.0), std::vector<double>(3 * n, 0.0)};
  std::vector<double> d_out(d_code.begin(), d_code.end());
  for (std::size_t j = n; j-- > 0;) {
    const bool root = e.parents[j] < 0;
    const auto parent = static_cast<std::size_t>(root ? 0 : e.parents[j]);
    const double* in = &tape.inputs[kPoseHidden * j];
    const double* hidden = &tape.hidden[kPoseHidden * j];
    double d_in[kPoseHidden] = {};
    for (std::size_t h = 0; h < kPoseHidden; ++h) {
      double d_hidden = 0;
      for (std::size_t f = 0; f < kPoseFeatures; ++f) {
        const std::size_t weight = (kPoseFeatures * j + f) * kPoseHidden + h;
        gradients->w2[weight] += d_out[kPoseFeatures * j + f] * hidden[h];
        d_hidden += d_out[kPoseFeatures * j + f] * e.w2[weight];
      }
      if (!(hidden[h] > 0)) continue;
      gradients->b1[kPoseHidden * j + h] += d_hidden;
      for (std::size_t i = 0; i < kPoseHidden; ++i) {
        const std::size_t weight = (kPoseHidden * j + h) * kPoseHidden + i;
        gradients->w1[weight] += d_hidden * in[i];
        d_in[i] += d_hidden * e.w1[weight];
      }
    }
    for (std::size_t f = 0; f < kPoseFeatures; ++f) {
      gradients->b2[kPoseFeatures * j + f] += d_out[kPoseFeatures * j + f];
      const double d_parent = d_in[kPoseChannels + 1 + f];
      if (!root) {
        d_out[kPoseFeatures * parent + f] += d_parent;
        continue;
      }
      gradients->global_b[f] += d_parent;
      const std::size_t row = f * kPoseChannels * n;
      for (std::size_t i = 0; i < 9 * n; ++i) {
        gradients->global_w[row + i] += d_parent * rotations[i];
        result.rotations[i] += d_parent * e.global_w[row + i];
      }
      for (std::size_t i = 0; i < 3 * n; ++i) {
        gradients->global_w[row + 9 * n + i] += d_parent * positions[i];
        result.positions[i] += d_parent * e.global_w[row + 9 * n + i];
      }
    }
    for (std::size_t i = 0; i < 9; ++i) result.rotations[9 * j + i] += d_in[i];
    const double length = in[kPoseChannels];
    for (std::size_t a = 0; a < 3; ++a) {
      const double bone = positions[3 * j + a] - (root ? 0 : positions[3 * parent + a]);
      const double d_bone = length > 0 ? d_in[kPoseChannels] * bone / length : 0;
      result.positions[3 * j + a] += d_in[9 + a] + d_bone;
      if (!root) result.positions[3 * parent + a] -= d_bone;
    }
  }
  return result;
}

}  // namespace arah::reference
