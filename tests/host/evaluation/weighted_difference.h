// A network that can stand where LPIPS is wanted and be computed by hand: the mean over the pixels of sum_c w_c |a_c - b_c|.
#pragma once

#include <string>
#include <vector>

#include "tests/host/evaluation/onnx_file.h"

namespace arah {

// The ONNX file. weights: of R, G and B.
inline std::string weighted_difference_network(const std::vector<float>& weights) {
  onnx::Graph graph;
  graph.input("in0", {onnx::open, 3, onnx::open, onnx::open});
  graph.input("in1", {onnx::open, 3, onnx::open, onnx::open});
  graph.output("distance", {onnx::open, 1, 1, 1});
  graph.constant("weights", {1, 3, 1, 1}, weights);
  graph.node("Sub", {"in0", "in1"}, "difference");
  graph.node("Abs", {"difference"}, "size");
  graph.node("Conv", {"size", "weights"}, "weighted", {{"kernel_shape", {1, 1}}});
  graph.node("GlobalAveragePool", {"weighted"}, "distance");
  return graph.file();
}

}  // namespace arah
