#include "viewer/view_state.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <numbers>
#include <set>
#include <utility>

#include "host/body/json_fields.h"
#include "host/file_writing.h"
#include "viewer/quality.h"

namespace arah {
namespace {

using nlohmann::ordered_json;

constexpr double kFarOff = 1e6;     // metres
constexpr double kMostTurn = 100;   // radians of an edit
constexpr double kMostShape = 100;
constexpr int kMostFrameNumber = std::numeric_limits<int>::max();

template <typename Enum>
using Words = std::vector<std::pair<const char*, Enum>>;

// Every field once, with its name and bounds, for writing and for reading.
template <typename State, typename Visitor>
void visit_fields(State& s, Visitor&& visit) {
  visit.object("viewpoint", [&](auto& f) {
    f.vector("target", s.viewpoint.target, kFarOff);
    f.word("up", s.viewpoint.up, Words<UpAxis>{{"y", UpAxis::y}, {"z", UpAxis::z}});
    f.number("yaw", s.viewpoint.yaw, -kMostTurn, kMostTurn);
    f.number("pitch", s.viewpoint.pitch, -89.0 * std::numbers::pi / 180.0, 89.0 * std::numbers::pi / 180.0);
    f.number("distance", s.viewpoint.distance, 0.05, 100);
    f.number("field_of_view", s.viewpoint.field_of_view, 0.05, 2.5);
  });
  visit.text("camera", s.camera);
  visit.number("turntable", s.turntable, -2 * std::numbers::pi, 2 * std::numbers::pi);
  visit.object("motion", [&](auto& f) {
    f.text("split", s.split);
    f.number("place", s.timeline.place, 0, kMostFrameNumber);
    f.flag("playing", s.timeline.playing);
    f.flag("backwards", s.timeline.backwards);
    f.number("speed", s.timeline.speed, kSlowest, kFastest);
    f.word("loop", s.timeline.loop, Words<Loop>{{to_string(Loop::around), Loop::around}, {to_string(Loop::once), Loop::once}, {to_string(Loop::there_and_back), Loop::there_and_back}});
  });
  visit.object("blend", [&](auto& f) {
    f.choice("frame", s.blend_frame, kMostFrameNumber);
    f.number("weight", s.blend_weight, 0, 1);
  });
  visit.object("edits", [&](auto& f) {
    f.vectors("turns", s.turns, kMostTurn);
    f.vector("shift", s.shift, kFarOff);
  });
  visit.choice("latent_row", s.latent_row, kMostFrameNumber);
  visit.numbers("shape", s.shape, kMostShape);
  visit.object("layer", [&](auto& f) {
    f.text("name", s.layer);
    f.text("joint", s.joint);
    f.number("slice", s.slice, -2, 2);
  });
  visit.object("overlays", [&](auto& f) {
    f.flag("skeleton", s.skeleton);
    f.flag("mesh", s.mesh);
    f.flag("handles", s.handles);
  });
  visit.object("comparison", [&](auto& f) {
    Words<ComparisonMode> modes;
    for (const ComparisonMode mode : {ComparisonMode::off, ComparisonMode::behind, ComparisonMode::blink, ComparisonMode::split, ComparisonMode::error_map}) modes.emplace_back(to_string(mode), mode);
    f.word("mode", s.comparison.mode, modes);
    f.number("position", s.comparison.position, 0, 1);
    f.number("period", s.comparison.period, kShortestBlink, kLongestBlink);
    f.number("gain", s.comparison.gain, kLeastErrorGain, kLargestErrorGain);
  });
  visit.object("render", [&](auto& f) {
    f.quality("quality", s.quality);
    f.knobs("knobs", s.knobs);
    f.flag("compare_with_exact", s.compare_with_exact);
  });
  visit.object("window", [&](auto& f) {
    f.integer("width", s.window_width, 64, 16384);
    f.integer("height", s.window_height, 64, 16384);
  });
  visit.flag("hint_seen", s.hint_seen);
}

class ViewWriter {
 public:
  explicit ViewWriter(ordered_json& json) : json_(json) {}

  template <typename Inner>
  void object(const char* name, const Inner& inner) {
    ordered_json& member = json_[name] = ordered_json::object();
    ViewWriter writer(member);
    inner(writer);
  }
  void number(const char* name, double value, double, double) { json_[name] = value; }
  void integer(const char* name, int value, int, int) { json_[name] = value; }
  void flag(const char* name, bool value) { json_[name] = value; }
  void text(const char* name, const std::string& value) { json_[name] = value; }
  void quality(const char* name, const std::string& value) { json_[name] = value; }
  void choice(const char* name, const std::optional<int>& value, int) { json_[name] = value ? ordered_json(*value) : ordered_json(); }
  void numbers(const char* name, const std::vector<double>& values, double) { json_[name] = values; }
  void vector(const char* name, const glm::dvec3& value, double) { json_[name] = {value.x, value.y, value.z}; }
  void vectors(const char* name, const std::map<std::string, glm::dvec3>& values, double) {
    json_[name] = ordered_json::object();
    for (const auto& [key, value] : values) json_[name][key] = {value.x, value.y, value.z};
  }
  void knobs(const char* name, const std::map<std::string, std::string>& values) {
    json_[name] = ordered_json::object();
    for (const auto& [key, value] : values) json_[name][key] = value;
  }
  template <typename Enum>
  void word(const char* name, Enum value, const Words<Enum>& words) {
    for (const auto& [text, candidate] : words)
      if (candidate == value) json_[name] = text;
  }

 private:
  ordered_json& json_;
};

// Takes the fields that it is asked for and refuses the rest.
class ViewReader {
 public:
  ViewReader(const nlohmann::json& json, const std::string& where, std::string path) : json_(json), where_(where), path_(std::move(path)) {
    if (!json.is_object()) throw InputError(where_, path_, "an object", json_excerpt(json));
  }

  template <typename Inner>
  void object(const char* name, const Inner& inner) {
    const nlohmann::json* member = take(name);
    if (member == nullptr) return;
    ViewReader reader(*member, where_, field(name));
    inner(reader);
    reader.refuse_others();
  }
  void number(const char* name, double& value, double least, double greatest) {
    if (const auto* member = take(name)) value = within(*member, least, greatest, field(name));
  }
  void integer(const char* name, int& value, int least, int greatest) {
    if (const auto* member = take(name)) value = json_integer(*member, least, greatest, where_, field(name));
  }
  void flag(const char* name, bool& value) {
    const auto* member = take(name);
    if (member == nullptr) return;
    if (!member->is_boolean()) throw InputError(where_, field(name), "true or false", json_excerpt(*member));
    value = member->get<bool>();
  }
  void text(const char* name, std::string& value) {
    if (const auto* member = take(name)) value = short_text(*member, field(name));
  }
  void choice(const char* name, std::optional<int>& value, int greatest) {
    if (const auto* member = take(name)) value = member->is_null() ? std::nullopt : std::optional(json_integer(*member, 0, greatest, where_, field(name)));
  }
  void numbers(const char* name, std::vector<double>& values, double greatest) {
    const auto* member = take(name);
    if (member == nullptr) return;
    values.clear();
    check_count(json_list(*member, -1, where_, field(name)).size(), kMaxShapes, field(name));
    for (const nlohmann::json& item : *member) values.push_back(within(item, -greatest, greatest, field(name)));
  }
  void vector(const char* name, glm::dvec3& value, double greatest) {
    if (const auto* member = take(name)) value = vector_within(*member, greatest, field(name));
  }
  void vectors(const char* name, std::map<std::string, glm::dvec3>& values, double greatest) {
    each(name, kMaxJoints, [&](const std::string& key, const nlohmann::json& item, const std::string& where) { values[key] = vector_within(item, greatest, where); });
  }
  void quality(const char* name, std::string& value) {
    text(name, value);
    const std::vector<std::string>& presets = render_presets();
    if (std::find(presets.begin(), presets.end(), value) == presets.end()) throw InputError(where_, field(name), fmt::format("one of {}", fmt::join(presets, ", ")), "'" + value + "'");
  }
  void knobs(const char* name, std::map<std::string, std::string>& values) {
    each(name, render_knobs().size(), [&](const std::string& key, const nlohmann::json& item, const std::string& where) {
      const std::string value = short_text(item, where);
      RenderSettings any;
      any.sampling.emplace();
      try {
        set_render_knob(any, key, value);
      } catch (const InputError& error) {
        throw InputError(fmt::format("{}: {}.{}", where_, field(name), error.what()));
      }
      values[key] = value;
    });
  }
  template <typename Enum>
  void word(const char* name, Enum& value, const Words<Enum>& words) {
    const auto* member = take(name);
    if (member == nullptr) return;
    const std::string text = json_text(*member, where_, field(name));
    std::vector<std::string> names;
    for (const auto& [known, candidate] : words) {
      names.emplace_back(known);
      if (text == known) {
        value = candidate;
        return;
      }
    }
    throw InputError(where_, field(name), fmt::format("one of {}", fmt::join(names, ", ")), json_excerpt(*member));
  }

  const nlohmann::json* take(const char* name) {
    known_.insert(name);
    const auto found = json_.find(name);
    return found == json_.end() ? nullptr : &*found;
  }
  void refuse_others() const {
    for (const auto& [name, value] : json_.items())
      if (!known_.contains(name)) throw InputError(where_, field(shortened(name)), fmt::format("one of {}", fmt::join(known_, ", ")), "an unknown field", "A newer version may have written it.");
  }

 private:
  static std::string shortened(const std::string& name) { return name.size() <= 60 ? name : name.substr(0, 57) + "..."; }
  std::string field(const std::string& name) const { return path_.empty() ? name : path_ + "." + name; }

  double within(const nlohmann::json& json, double least, double greatest, const std::string& name) const {
    const double value = json_number(json, where_, name);
    if (value < least || value > greatest) throw InputError(where_, name, fmt::format("a number from {} to {}", least, greatest), json_excerpt(json));
    return value;
  }
  glm::dvec3 vector_within(const nlohmann::json& json, double greatest, const std::string& name) const {
    json_list(json, 3, where_, name);
    return {within(json[0], -greatest, greatest, name), within(json[1], -greatest, greatest, name), within(json[2], -greatest, greatest, name)};
  }
  std::string short_text(const nlohmann::json& json, const std::string& name) const {
    std::string text = json_text(json, where_, name);
    check_count(text.size(), kLongestViewText, name, "bytes");
    return text;
  }
  void check_count(std::size_t count, std::size_t most, const std::string& name, const char* of = "values") const {
    if (count > most) throw InputError(where_, name, fmt::format("at most {} {}", most, of), fmt::format("{}", count));
  }
  template <typename Each>
  void each(const char* name, std::size_t most, const Each& take_item) {
    const auto* member = take(name);
    if (member == nullptr) return;
    if (!member->is_object()) throw InputError(where_, field(name), "an object", json_excerpt(*member));
    check_count(member->size(), most, field(name));
    for (const auto& [key, item] : member->items()) {
      const std::string item_field = field(name) + "." + shortened(key);
      check_count(key.size(), kLongestViewText, item_field, "bytes");
      take_item(key, item, item_field);
    }
  }

  const nlohmann::json& json_;
  const std::string& where_;
  std::string path_;
  std::set<std::string> known_;
};

}  // namespace

std::string view_state_json(const ViewState& state) {
  ordered_json json;
  json["arah_view"] = 1;
  visit_fields(state, ViewWriter(json));
  return json.dump(1, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

ViewState view_state_from_json(std::string_view text, const std::string& where) {
  const nlohmann::json json = parse_json(text, where);
  ViewReader reader(json, where, "");
  const nlohmann::json* version = reader.take("arah_view");
  if (version == nullptr || *version != 1) throw InputError(where, "arah_view", "1, as in a view of this version", version == nullptr ? "none" : json_excerpt(*version));
  ViewState state;
  visit_fields(state, reader);
  reader.refuse_others();
  return state;
}

void write_view_state(const std::filesystem::path& path, const ViewState& state) {
  const std::string text = view_state_json(state);
  view_state_from_json(text, path.string());
  write_file_safely(path, text);
}

ViewState read_view_state(const std::filesystem::path& path) {
  if (!std::filesystem::is_regular_file(path)) throw InputError(path.string(), "", "a view, as arah-view saves it", "none that can be opened");
  const MappedFile file(path, kMostViewFile);
  return view_state_from_json(file.bytes(), path.string());
}

PoseEdits edits_of(const ViewState& state, const Skeleton& skeleton, const std::string& where) {
  PoseEdits edits{{}, state.shift};
  if (!state.turns.empty()) edits.turns.assign(skeleton.size(), glm::dvec3(0.0));
  for (const auto& [name, turn] : state.turns) {
    const int joint = find_joint(skeleton, name);
    if (joint < 0) throw InputError(where, "edits.turns", "joints of the avatar", fmt::format("'{}', which it lacks", name), "The view was saved with another avatar.");
    edits.turns[static_cast<std::size_t>(joint)] = turn;
  }
  return edits;
}

void set_edits(ViewState& state, const Skeleton& skeleton, const PoseEdits& edits) {
  state.turns.clear();
  for (std::size_t j = 0; j < edits.turns.size(); ++j)
    if (edits.turns[j] != glm::dvec3(0.0)) state.turns[skeleton.names.at(j)] = edits.turns[j];
  state.shift = edits.shift;
}

RenderSettings render_settings_of(const ViewState& state, const Avatar& avatar) { return preset_with_knobs(avatar, state.quality, state.knobs); }

}  // namespace arah
