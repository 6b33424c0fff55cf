#include "host/cli/outcome.h"

#include <fmt/format.h>

#include <cstdio>
#include <exception>
#include <new>

#include "host/input_error.h"
#include "kernels/vulkan/device.h"

namespace arah {

int report_error(const std::string& program, const std::string& text, int code) {
  std::string line;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '\n') {
      line.push_back(text[i]);
    } else {
      while (i + 1 < text.size() && (text[i + 1] == ' ' || text[i + 1] == '\n')) ++i;
      line += "; ";
    }
  }
  std::fputs(fmt::format("{}: {}\n", program, line).c_str(), stderr);  // fmt::print would throw where the terminal is gone
  return code;
}

int outcome_of(const std::string& program, const std::function<int()>& run) {
  try {
    return run();
  } catch (const InputError& error) {
    return report_error(program, error.what(), kWrongCall);
  } catch (const MemoryCeilingError& error) {
    return report_error(program, error.what(), kWrongCall);
  } catch (const std::bad_alloc&) {
    return report_error(program, "the machine's memory is used up. Use fewer rays a chunk, a smaller picture, or --memory.", kFailed);
  } catch (const std::exception& error) {
    return report_error(program, error.what(), kFailed);
  }
}

}  // namespace arah
