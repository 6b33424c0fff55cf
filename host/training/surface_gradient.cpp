#include "host/training/surface_gradient.h"

#include "kernels/skinning/implicit_joint_cotangent.h"

namespace arah {

SurfaceGradient::SurfaceGradient(Device& device, AvatarNetworks& networks, uint32_t rows, SkinningGradient* skinning, const BufferSlice& counts)
    : networks_(networks), skinning_(skinning), counts_(counts), cotangents_(device, "surface gradient: cotangents", padded_points(rows) * 16ull, BufferPlace::device) {}

void SurfaceGradient::record(Commands& commands, FrameOnDevice& frame, RaySamples& placed, ShadedRays& shaded, uint32_t rays, bool skinning_weights, bool accumulate, const BufferSlice& scratch) {
  Field& field = shaded.field();
  const Field::Inputs& in = shaded.inputs();
  ImplicitJointCotangentArgs joint;
  if (skinning_) {
    skinning_->record_jacobians(commands, frame, in.rows, in.canonical);
    joint.jacobians = skinning_->jacobians();
  } else {
    joint.jacobians = placed.root_finder().record_transforms(commands, frame, {{in.rows, {}}, in.samples}, in.canonical);
  }
  if (!networks_.spec().color.normal) field.record_gradient(commands, in);
  joint.rays = in.rows;
  joint.frame = frame.constants();
  joint.ray_list = in.rays;
  joint.sdf_gradients = field.gradient();
  joint.upstream = field.position_gradient();
  joint.canonical = in.canonical;
  joint.cotangents = cotangents_.slice();
  joint.sdf_cotangents = field.d_sdf();
  joint.counts = counts_;
  joint.of_row = in.samples;
  joint.listed = rays;
  record_implicit_joint_cotangent(commands, joint);
  field.record_backward_from_distances(commands, in);
  if (skinning_weights) skinning_->record_from_cotangents(commands, frame, in.rows, in.canonical, cotangents_.slice(), accumulate, scratch);
}

}  // namespace arah
