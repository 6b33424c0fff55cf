// The skinning network at given canonical points on the device, forward, its Jacobians, and back from cotangents.
#pragma once

#include <string>
#include <vector>

#include "kernels/reference/skinning.h"
#include "kernels/skinning/jacobian.h"
#include "kernels/skinning/lbs.h"
#include "kernels/skinning/lbs_backward.h"
#include "tests/kernels/device_networks.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {

// Everything that the implicit gradient reads of the network and writes to it.
struct SkinningAt {
  SkinningAt(Device& device, const reference::SkinningNetwork& network, const std::vector<double>& bones, const std::vector<double>& x)
      : points(static_cast<uint32_t>(x.size() / 3)), tree(smpl_tree()), dense(device, network.layers, points) {
    const uint64_t padded = padded_points(points);
    auto make = [&](const char* what, uint64_t bytes) { return Buffer(device, what, bytes, BufferPlace::device); };
    frame = make("frame", sizeof(FrameConstants));
    const FrameConstants constants = frame_constants(network.cube, bones);
    device.upload(frame.slice(), &constants, sizeof constants);
    canonical = make("canonical", padded * 16);
    std::vector<float> rows = padded_rows(x, 3, 4);
    for (size_t row = 0; row < rows.size() / 4; ++row) rows[4 * row + 3] = 1;  // a root
    device.upload(canonical.slice(), rows);
    posed = make("posed", padded * 16), transforms = make("transforms", padded * 48), jacobians = make("jacobians", padded * 48);
    for (Buffer& gradient : gradients) gradient = make("gradient", padded * channel_padding * 4);
    cotangents = make("cotangents", padded * 16);
    bone_weights = make("weights", padded * weight_stride * 4);
    counts = make("counts", 256);
    device.upload(counts.slice(), std::vector<uint32_t>(64, 0));
    std::vector<double> n;
    for (size_t p = 0; p < points; ++p)
      for (const double value : network.cube.to_cube({x[3 * p], x[3 * p + 1], x[3 * p + 2]})) n.push_back(value);
    dense.write_input(n, points);
  }

  void record_jacobians(Commands& commands) {
    dense.network.record_pack(commands);
    dense.network.record_forward(commands, dense.tape, {points, {}});
    record_lbs(commands, {&tree, rows(), dense.tape.output(), frame.slice(), canonical.slice(), posed.slice(), transforms.slice(), {bone_weights.slice(), weight_stride, 0}});
    JacobianArgs jacobian{{points, {}}, frame.slice(), transforms.slice(), {}, jacobians.slice()};
    for (uint32_t i = 0; i < 3; ++i) {
      record_lbs_backward(commands, {&tree, rows(), dense.tape.output(), frame.slice(), canonical.slice(), {}, i, dense.tape.output_gradient(), {}});
      DenseNetwork::Backward through;
      through.weight_gradients = false;
      through.input_gradient = true;
      jacobian.gradients[i] = through.input_gradient_result = {gradients[i].slice(), channel_padding, 0};
      dense.network.record_backward(commands, dense.tape, {points, {}}, through);
    }
    record_jacobian(commands, jacobian);
  }

  // From `cotangents` to the raw gradients of the network.
  void record_back(Commands& commands) {
    record_lbs_backward(commands, {&tree, rows(), dense.tape.output(), frame.slice(), canonical.slice(), cotangents.slice(), 3, dense.tape.output_gradient(), {}});
    DenseNetwork::Backward weights;
    weights.scratch = dense.scratch.slice();
    dense.network.record_backward(commands, dense.tape, {points, {}}, weights);
    dense.network.record_unpack(commands);
  }

  Rows rows() const { return {{points, {}}, {}}; }

  static constexpr uint32_t weight_stride = 24;
  uint32_t points;
  JointTree tree;
  DeviceDense dense;
  Buffer frame, canonical, posed, transforms, jacobians, gradients[3], cotangents, bone_weights, counts;
};

}  // namespace arah
