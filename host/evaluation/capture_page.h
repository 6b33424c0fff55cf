// inspect.html: a capture before anything is trained on it, as one page that opens in any browser, without a network.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/capture/inspect.h"

namespace arah {

// The picture of the view's worst frame as an opaque PNG, at most 512 columns, small ones enlarged by a whole factor: the photograph, grey where it is transparent; the template in
// cyan, its outlines and where one limb ends before another; the mask's outline in orange. Throws InputError as load_image does.
std::vector<std::uint8_t> fit_picture(const Capture& capture, const InspectedView& view);

// The whole page: what looks wrong, plan and elevation (scene_plan.h), coverage of every view as a table, a picture of each view, the report. Pictures that cannot be read are
// left out: the report says so. Every text is escaped; the page runs no script and asks for no other file.
std::string capture_page(const Capture& capture, const CaptureInspection& found);

}  // namespace arah
