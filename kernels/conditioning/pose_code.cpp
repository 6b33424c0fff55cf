#include "kernels/conditioning/pose_code.h"

#include <fmt/format.h>

#include <stdexcept>

namespace arah {
namespace {

uint64_t pose_bytes(const PoseCodeArgs& args) { return uint64_t(args.joints) * shared::pose_channels * 4; }
uint64_t hidden_bytes(const PoseCodeArgs& args) { return uint64_t(args.joints) * shared::pose_hidden * 4; }
uint64_t code_bytes(const PoseCodeArgs& args) { return uint64_t(args.joints) * shared::pose_features * 4; }
double multiplications(const PoseCodeArgs& args) {
  return double(args.joints) * (shared::pose_hidden + shared::pose_features) * shared::pose_hidden +
         double(args.joints) * shared::pose_features * shared::pose_channels;
}

shared::PoseEncoderConstants constants_of(const PoseCodeArgs& args) {
  if (args.joints == 0 || args.joints > shared::most_joints)
    throw std::invalid_argument(fmt::format("pose encoder: {} joints, 1 to {} expected", args.joints, shared::most_joints));
  shared::PoseEncoderConstants constants = args.at;
  constants.joints = args.joints;
  return constants;
}

}  // namespace

void record_pose_code(Commands& commands, const PoseCodeArgs& args) {
  const shared::PoseEncoderConstants constants = constants_of(args);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("conditioning/pose_code");
  launch.name = "pose encoder";
  launch.bindings = {{args.parents, args.joints * 4ull},
                     {args.pose, pose_bytes(args)},
                     args.parameters,
                     {args.inputs, hidden_bytes(args)},
                     {args.hidden, hidden_bytes(args)},
                     {args.code, code_bytes(args)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {2 * multiplications(args), 4 * multiplications(args)};
  commands.dispatch(launch);
}

void record_pose_code_backward(Commands& commands, const PoseCodeBackwardArgs& args) {
  const PoseCodeArgs& forward = args.forward;
  const shared::PoseEncoderConstants constants = constants_of(forward);
  Launch launch;
  launch.pipeline = &commands.device().pipeline("conditioning/pose_code_backward");
  launch.name = "pose encoder: backward";
  launch.bindings = {{forward.parents, forward.joints * 4ull},
                     {forward.pose, pose_bytes(forward)},
                     forward.parameters,
                     {forward.inputs, hidden_bytes(forward)},
                     {forward.hidden, hidden_bytes(forward)},
                     {args.d_code, code_bytes(forward)},
                     {args.gradients, forward.parameters.bytes},
                     {args.d_pose, pose_bytes(forward)}};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  launch.cost = {4 * multiplications(forward), 12 * multiplications(forward)};
  commands.dispatch(launch);
}

}  // namespace arah
