// The viewer as a process of its own: training needs nothing of it.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace arah {

// arah-view beside this program, else on the PATH; empty where there is none, as in a build without it.
std::filesystem::path viewer_program();

// Starts it with these words and does not wait for it. It goes on when this program ends, and Ctrl-C is not for it. Returns whether it
// could be started.
bool start_viewer(const std::filesystem::path& program, const std::vector<std::string>& words);

}  // namespace arah
