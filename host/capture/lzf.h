// LZF, the compression that h5py brings to HDF5 files (filter 32000).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace arah {

// A byte below 32 says that so many bytes and one more follow as they are. Another one repeats what is there already: its upper
// three bits are the length less two (seven: the next byte is added), its lower five and the next byte how far back, less
// one. Gives the unpacked bytes, at most `most`; none where the packed ones end early, refer to before the beginning or
// hold more. 3 bytes become 264 at most.
std::vector<std::uint8_t> unpack_lzf(std::span<const std::uint8_t> packed, std::size_t most);

}  // namespace arah
