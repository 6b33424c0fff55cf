// Names and tree of the joints of SMPL (24), SMPL-H (52) and SMPL-X (55), in the order in which their files count them.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace arah {

// Throws InputError naming `where` for any other number of joints.
std::vector<std::string> smpl_joint_names(std::size_t joints, const std::string& where);
// -1 for the root.
std::vector<int> smpl_joint_parents(std::size_t joints, const std::string& where);

}  // namespace arah
