#include "host/training/surface_gradient.h"

#include "kernels/skinning/implicit_joint_cotangent.h"

namespace arah {

SurfaceGradient::SurfaceGradient(Device& device, AvatarNetworks& networks, uint32_t rows, SkinningGradient* skinning)
    : networks_(networks), skinning_(skinning), cotangents_(device, "surface gradient: cotangents", padded_points(rows) * 16ull, BufferPlace::device),
      singular_(device, "surface gradient: count of singular Jacobians", 4, BufferPlace::shared) {
  Commands zero(device);
  zero.fill(singular_.slice(), 0);
  zero.submit_and_wait();
}

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
  joint.singular_count = singular_.slice();
  joint.of_row = in.samples;
  joint.listed = rays;
  record_implicit_joint_cotangent(commands, joint);
  field.record_backward_from_distances(commands, in);
  if (skinning_weights) skinning_->record_from_cotangents(commands, frame, in.rows, in.canonical, cotangents_.slice(), accumulate, scratch);
}

}  // namespace arah
