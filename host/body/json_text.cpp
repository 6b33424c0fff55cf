#include "host/body/json_text.h"

#include "host/input_error.h"

namespace arah {

void check_json_text(std::string_view text, const std::string& where, const std::string& field, const JsonCost& cost) {
  std::size_t depth = 0, bytes = 0;
  bool quoted = false;
  for (std::size_t at = 0; at < text.size(); ++at) {
    const char letter = text[at];
    if (quoted) {
      if (letter == '\\') ++at;
      else if (letter == '"') quoted = false;
      continue;
    }
    switch (letter) {
      case '"':
        quoted = true;
        bytes += cost.text;
        break;
      case '[':
      case '{':
        if (++depth > kMostJsonDepth) throw InputError(where, field, fmt::format("JSON that is nested at most {} deep", kMostJsonDepth), "deeper lists or objects");
        bytes += cost.list + cost.item;
        break;
      case ']':
      case '}':
        if (depth > 0) --depth;
        break;
      case ',':
        bytes += cost.item;
        break;
      case ':':
        bytes += cost.member;
        break;
      default:
        break;
    }
  }
  if (bytes > cost.most) throw InputError(where, field, fmt::format("JSON that takes at most {} MB of memory", cost.most / 1'000'000), fmt::format("values that take {} MB", bytes / 1'000'000));
}

}  // namespace arah
