// Folders of datasets whose files are called by their frame.
#pragma once

#include <filesystem>
#include <initializer_list>
#include <map>

namespace arah {

// The files of a folder by the frame that their names state: "000012.jpg" is frame 12. Of others, and where there is no folder:
// none.
std::map<int, std::filesystem::path> files_by_frame(const std::filesystem::path& folder, std::initializer_list<const char*> extensions);

}  // namespace arah
