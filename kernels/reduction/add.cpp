#include "kernels/reduction/add.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "kernels/linear/matrix.h"
#include "kernels/optimizer/chunks.h"

namespace arah {

void record_add(Commands& commands, const BufferSlice& x, const BufferSlice& y, const char* name) {
  const uint64_t count = range_floats(name, y.bytes);
  if (x.bytes != y.bytes) throw std::invalid_argument(fmt::format("{}: {} bytes to add to {}", name, x.bytes, y.bytes));
  for (uint64_t first = 0; first < count; first += optimizer_chunk) {
    const uint64_t floats = std::min(optimizer_chunk, count - first);
    const uint32_t eights = static_cast<uint32_t>(floats / 8);
    Launch launch;
    launch.pipeline = &commands.device().pipeline("reduction/add");
    launch.name = name;
    launch.groups = {padded_points(eights) / point_padding, 1, 1};
    launch.bindings = {{x.elements(first, floats), floats * 4}, {y.elements(first, floats), floats * 4}};
    launch.push_constants = &eights;
    launch.push_constant_bytes = sizeof eights;
    launch.after_previous = first == 0;
    launch.cost = {double(floats), 12.0 * double(floats)};
    commands.dispatch(launch);
  }
}

}  // namespace arah
