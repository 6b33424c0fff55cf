#include "host/cli/shader_progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include "host/cli/progress.h"

namespace arah {
namespace {

constexpr double kNoticed = 0.5;       // seconds of compiling before a word is said
constexpr double kPlainRepeat = 10.0;  // seconds between two lines where there is no terminal

}  // namespace

ShaderLine::ShaderLine(std::FILE* stream) : stream_(stream), terminal_(::isatty(::fileno(stream)) == 1) {}

void ShaderLine::show(const ShaderProgress& progress) {
  if (progress.seconds < kNoticed) return;
  const std::string line = fmt::format("compiling shaders: {} of {}, {:.0f} s", progress.ready, progress.pipelines, progress.seconds);
  if (terminal_) {
    // Gone as soon as the shader is done: a progress bar may draw on the same line.
    write_text(stream_, "\r\x1b[K" + (progress.done ? "" : line));
    std::fflush(stream_);
    return;
  }
  const auto now = std::chrono::steady_clock::now();
  if (progress.done || (said_ && std::chrono::duration<double>(now - last_).count() < kPlainRepeat)) return;
  write_text(stream_, fmt::format("{}{}\n", line, said_ ? "" : " (the driver keeps them; the next start is quick)"));
  std::fflush(stream_);
  said_ = true;
  last_ = now;
}

std::string shaders_text(const Device& device) {
  return fmt::format("{} shaders in {:.1f} s", device.pipelines_made(), device.pipeline_seconds());
}

}  // namespace arah
