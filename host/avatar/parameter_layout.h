// Where each learned tensor lies in the one flat float32 buffer that holds all of an avatar's parameters. Gradients and
// the optimiser's moments have the same layout.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/avatar/avatar_spec.h"
#include "host/avatar/grid_extent.h"
#include "host/body/skeleton.h"

namespace arah {

// Offsets are multiples of this many floats (256 bytes), which satisfies every device's binding alignment.
inline constexpr uint64_t kSlotAlignment = 64;

// Row-major. The levels of the grid follow each other without a gap, because kernels read them as one buffer: only
// grid.0 is aligned to kSlotAlignment, the others to four floats.
struct TensorSlot {
  std::string name;
  std::vector<int64_t> shape;
  uint64_t offset = 0;  // floats from the start of the buffer
  uint64_t count = 0;   // floats

  bool operator==(const TensorSlot&) const = default;
};

// A contiguous range that shares learning rate and decay. Empty (begin == end) where the part is absent.
struct ParameterGroup {
  std::string name;
  uint64_t begin = 0;  // floats, a multiple of kSlotAlignment
  uint64_t end = 0;

  uint64_t size() const { return end - begin; }
  bool operator==(const ParameterGroup&) const = default;
};

// Groups, in this order, all of them always there, and their tensors ([out, in] for matrices; i counts linear layers):
//   sdf        sdf.i.W [out, in], sdf.i.b [out]
//   mapping    mapping.i.W, mapping.i.b
//   skinning   skinning.i.v [out, in], skinning.i.g [out], skinning.i.b [out]: weight norm, W = g v/|v| row by row
//   color      color.i.v, color.i.g, color.i.b
//   latent     latent [frames, latent size]
//   deviation  b [1], the scale of the Laplace density, metres
//   pose_code  pose_code.{global.W [6, 12 joints], global.b, 1.W [joints, 19, 19], 1.b, 2.W [joints, 6, 19], 2.b}
//   hyper      hyper.i.W [SDF layers, pose width, in], hyper.i.{b, scale, shift} [SDF layers, pose width]: of all layers
//   low_rank   low_rank.l.U [out, rank], low_rank.l.V [rank, in], low_rank.l.C [out, rank], one a layer of the SDF
//   grid       grid.i [nodes z, nodes y, nodes x, 4]
//   hyper_last hyper_last.l.W [out · in, pose width], hyper_last.l.b [out, pose width]: the paper's 85 million numbers, whose
//              gradients, outer products, are nowhere written out: buffers of gradients end before it
struct ParameterLayout {
  std::vector<TensorSlot> slots;       // in the order of their offsets
  std::vector<ParameterGroup> groups;  // end to end from 0 to floats
  uint64_t floats = 0;                 // of the whole buffer, padding between slots included

  bool has(const std::string& name) const;
  // Throw std::out_of_range naming what was asked for where it is absent.
  const TensorSlot& slot(const std::string& name) const;
  const ParameterGroup& group(const std::string& name) const;
  // Learned numbers, without padding: of the whole or of one group.
  uint64_t parameter_count() const;
  uint64_t parameter_count(const std::string& group_name) const;

  bool operator==(const ParameterLayout&) const = default;
};

// Outputs of the skinning network: one logit a joint, and one more for every joint other than the root with several
// children. Logit j belongs to joint j, the root's is the gate of its children, the further ones gate theirs in joint
// order (ARAH.md section 2; SMPL: 25).
uint32_t skinning_logit_count(const Skeleton& skeleton);

// The spec must be valid, and `grid` what make_grid_extent gives for it or an extent with as many levels.
// latent_frames: rows of the latent codes; must be at least 1 where the spec has a latent size (std::invalid_argument).
ParameterLayout make_parameter_layout(const AvatarSpec& spec, const Skeleton& skeleton, std::size_t latent_frames,
                                      const GridExtent& grid);

// First values of all parameters, [layout.floats]; padding is 0. Each tensor draws from a stream of its own, made from
// the seed and the tensor's name, so that the same part starts alike in avatars that differ elsewhere.
//   sdf       first W uniform in ±1/in, the others ±√(6/in)/ω; biases ±1/√in
//   mapping   W normal, √(2/(1.04 in)) (Kaiming for slope 0.2), biases ±1/√in; last W 0, its bias 1 for γ and 0 for η
//   skinning, color   v and b uniform in ±1/√in, g = |v| row by row
//   pose_code W and b uniform in ±1/√in;   hyper   W normal, √(2/in), biases ±1/√in, scale 1, shift 0
//   low_rank  U and C 0, V normal, 1/√in;   hyper_last   0: the SDF begins as the one that all poses share
//   latent    normal, spec.latent_init_std;   b   spec.b_init;   grid   normal, 0.01
std::vector<float> initial_parameters(const AvatarSpec& spec, const ParameterLayout& layout, uint64_t seed);

}  // namespace arah
