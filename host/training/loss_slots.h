// Where a training step's losses lie in their buffer, and what events.jsonl calls them.
#pragma once

#include <array>
#include <cstdint>

namespace arah {

// The image and the mask loss fill two each.
enum LossSlot : uint32_t { color_slot, alpha_slot, eikonal_slot, off_surface_slot, inside_slot, skinning_slot, parameter_slot, mask_slot, mask_alpha_slot, loss_slots };
inline constexpr std::array<const char*, loss_slots> loss_names{"color", "alpha", "eikonal", "off_surface", "inside", "skinning", "parameters", "mask", "mask_alpha"};

}  // namespace arah
