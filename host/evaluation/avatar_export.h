// An avatar for other programs: its surface with what moves and colours it.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/body/skinned_gltf.h"
#include "host/evaluation/mesh_extraction.h"
#include "host/evaluation/mesh_files.h"

namespace arah {

enum class MeshColors { texture, vertex, none };

// A pose that is exported, and the row of codes that belongs to it.
struct ExportedFrame {
  Pose pose;
  std::size_t latent_row = 0;
};

struct ModelSettings {
  MeshColors colors = MeshColors::texture;
  int texture_size = 1024;  // texels
  std::string name = "avatar";
  std::string motion;  // the animation's name
  bool animated = false;  // with the frames as its animation; else the first one only decides code and pose
  // Vertices move to where rendering shows the outline (MeshExtraction::outlines).
  bool outlined = false;
  std::size_t most_correctives = 8;  // components of an animation's morph targets, where the shape follows the frames; one or two targets each
  bool z_up = false;      // the frames' world; the file's is y-up
  double frames_per_second = 25;
};

// What the file cannot hold exactly.
struct ModelReport {
  std::size_t vertices = 0, triangles = 0, charts = 0;
  double texel = 0;                      // metres, its edge where the surface faces its chart's way
  double simplified = 0;                 // metres that the surface moved by for fewer triangles
  std::size_t correctives = 0;
  double mean_left = 0, most_left = 0;   // metres that frames' shapes are off the file's, beside skinning
  double mean_outline = 0;               // metres that vertices moved out for `outlined`
  double mean_lost = 0, most_lost = 0;   // weight of influences beyond the fourth
  double mean_moved = 0, most_moved = 0; // what that moves vertices by, metres, over the frames
};

// The mesh in the canonical pose, bound there: so that the file's skin, which blends as ours does, gives what the
// avatar gives (docs/decisions/export.md). A shape that follows pose or code is that of the first frame, and of an animation's other
// frames by morph targets (shape_correctives.h). Colours are those of the first frame's code and pose.
// frames: at least one; of `animated` all are key frames. An avatar without skinning is a mesh that stands in its pose.
SkinnedModel skinned_model(MeshExtraction& extraction, const Avatar& avatar, const std::vector<ExportedFrame>& frames, const ModelSettings& settings, ModelReport& report,
                           const std::function<void(double)>& progress = {});
std::string describe(const ModelReport& report);

// The mesh in a frame's pose, in its world, with a colour for each vertex where wanted.
ColoredMesh posed_mesh(MeshExtraction& extraction, const ExportedFrame& frame, bool colored);

}  // namespace arah
