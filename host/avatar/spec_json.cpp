// The JSON form of an AvatarSpec.
#include <cmath>
#include <limits>
#include <set>

#include "host/avatar/avatar_spec.h"
#include "host/body/json_fields.h"

namespace arah {
namespace {

using nlohmann::ordered_json;

// One object of the text: takes the fields that are asked for and refuses the rest.
class Fields {
 public:
  // complete: a field that is asked for and absent is an error.
  Fields(const nlohmann::json& object, std::string where, std::string path, bool complete)
      : object_(object), where_(std::move(where)), path_(std::move(path)), complete_(complete) {
    if (!object.is_object()) throw InputError(where_, path_, "an object", json_excerpt(object));
  }

  // later: a field that older files do not have; absent, its value stays.
  const nlohmann::json* take(const char* name, bool later = false) {
    known_.insert(name);
    const auto found = object_.find(name);
    if (found != object_.end()) return &*found;
    if (complete_ && !later) throw InputError(where_, field(name), "this field", "none");
    return nullptr;
  }

  void read(const char* name, uint32_t& value, bool later = false) {
    // Ranges are validate_spec's; here the number only has to fit.
    if (const auto* json = take(name, later)) {
      value = static_cast<uint32_t>(json_integer(*json, 0, std::numeric_limits<int>::max(), where_, field(name)));
    }
  }
  void read(const char* name, int32_t& value) {
    if (const auto* json = take(name)) {
      value = json_integer(*json, -1, std::numeric_limits<int>::max(), where_, field(name));
    }
  }
  void read(const char* name, double& value) {
    if (const auto* json = take(name)) value = json_number(*json, where_, field(name));
  }
  void read(const char* name, bool& value) {
    const auto* json = take(name);
    if (json == nullptr) return;
    if (!json->is_boolean()) throw InputError(where_, field(name), "true or false", json_excerpt(*json));
    value = json->get<bool>();
  }
  void read(const char* name, std::string& value) {
    if (const auto* json = take(name)) value = json_text(*json, where_, field(name));
  }
  void read(const char* name, std::vector<double>& values) {
    const auto* json = take(name);
    if (json == nullptr) return;
    values.clear();
    for (const auto& item : json_list(*json, -1, where_, field(name))) {
      values.push_back(json_number(item, where_, field(name)));
    }
  }

  // Throws for the first field that nothing asked for.
  void refuse_others() const {
    for (const auto& [name, value] : object_.items()) {
      if (!known_.contains(name)) {
        throw InputError(where_, field(name), fmt::format("one of {}", fmt::join(known_, ", ")), "an unknown field",
                         "A newer version may have written it.");
      }
    }
  }

  std::string field(const std::string& name) const { return path_.empty() ? name : path_ + "." + name; }

 private:
  const nlohmann::json& object_;
  std::string where_, path_;
  bool complete_;
  std::set<std::string> known_;
};

Skinning parse_skinning(const std::string& text, const std::string& where, const std::string& field) {
  for (Skinning kind : {Skinning::none, Skinning::template_weights, Skinning::network, Skinning::backward}) {
    if (text == to_string(kind)) return kind;
  }
  throw InputError(where, field, "none, template_weights, network or backward",
                   text == "grid" ? "'grid', which is not in this version" : "'" + text + "'");
}

SdfConditioning parse_conditioning(const std::string& text, const std::string& where, const std::string& field) {
  for (SdfConditioning kind : {SdfConditioning::none, SdfConditioning::latent}) {
    if (text == to_string(kind)) return kind;
  }
  throw InputError(where, field, "none or latent", "'" + text + "'");
}

template <typename Word>
Word parse_word(const nlohmann::json& json, std::initializer_list<Word> words, const std::string& where,
                const std::string& field) {
  const std::string text = json_text(json, where, field);
  std::vector<std::string> known;
  for (Word word : words) {
    if (text == to_string(word)) return word;
    known.emplace_back(to_string(word));
  }
  throw InputError(where, field, fmt::format("{}", fmt::join(known, " or ")), "'" + text + "'");
}

AvatarSpec read_spec(AvatarSpec spec, const std::string& text, const std::string& where, bool complete) {
  const nlohmann::json json = parse_json(text, where);
  Fields top(json, where, "", complete);
  top.read("preset", spec.preset);
  if (const auto* part = top.take("skinning")) {
    Fields fields(*part, where, "skinning", complete);
    std::string kind = to_string(spec.skinning.kind);
    fields.read("kind", kind);
    spec.skinning.kind = parse_skinning(kind, where, fields.field("kind"));
    fields.read("width", spec.skinning.width);
    fields.read("hidden_layers", spec.skinning.hidden_layers);
    fields.refuse_others();
  }
  if (const auto* part = top.take("sdf")) {
    Fields fields(*part, where, "sdf", complete);
    fields.read("width", spec.sdf.width);
    fields.read("sine_layers", spec.sdf.sine_layers);
    fields.read("omega", spec.sdf.omega);
    std::string conditioning = to_string(spec.sdf.conditioning);
    fields.read("conditioning", conditioning);
    spec.sdf.conditioning = parse_conditioning(conditioning, where, fields.field("conditioning"));
    fields.read("mapping_width", spec.sdf.mapping_width);
    fields.read("mapping_hidden_layers", spec.sdf.mapping_hidden_layers);
    if (const auto* pose = fields.take("pose", true)) {
      spec.sdf.pose = parse_word(*pose, {PoseConditioning::none, PoseConditioning::low_rank, PoseConditioning::hypernetwork}, where, fields.field("pose"));
    }
    fields.read("pose_width", spec.sdf.pose_width, true);
    fields.read("pose_hidden_layers", spec.sdf.pose_hidden_layers, true);
    if (const auto* kind = fields.take("kind", true)) {
      spec.sdf.kind = parse_word(*kind, {FieldKind::sdf, FieldKind::density}, where, fields.field("kind"));
    }
    fields.refuse_others();
  }
  if (const auto* part = top.take("color")) {
    Fields fields(*part, where, "color", complete);
    fields.read("width", spec.color.width);
    fields.read("hidden_layers", spec.color.hidden_layers);
    fields.read("skip", spec.color.skip);
    fields.read("narrow", spec.color.narrow);
    fields.read("view", spec.color.view);
    fields.read("normal", spec.color.normal);
    fields.read("feature", spec.color.feature);
    fields.read("latent", spec.color.latent);
    if (const auto* space = fields.take("directions", true)) {
      spec.color.directions = parse_word(*space, {DirectionSpace::observation, DirectionSpace::canonical}, where, fields.field("directions"));
    }
    fields.refuse_others();
  }
  top.read("latent_size", spec.latent_size);
  top.read("latent_init_std", spec.latent_init_std);
  top.read("b_init", spec.b_init);
  top.read("grid_cells", spec.grid_cells);
  top.refuse_others();
  validate_spec(spec, where);
  return spec;
}

}  // namespace

std::string spec_to_json(const AvatarSpec& spec) {
  ordered_json json;
  json["preset"] = spec.preset;
  json["skinning"] = {{"kind", to_string(spec.skinning.kind)},
                      {"width", spec.skinning.width},
                      {"hidden_layers", spec.skinning.hidden_layers}};
  json["sdf"] = {{"width", spec.sdf.width},
                 {"sine_layers", spec.sdf.sine_layers},
                 {"omega", spec.sdf.omega},
                 {"conditioning", to_string(spec.sdf.conditioning)},
                 {"mapping_width", spec.sdf.mapping_width},
                 {"mapping_hidden_layers", spec.sdf.mapping_hidden_layers},
                 {"pose", to_string(spec.sdf.pose)},
                 {"pose_width", spec.sdf.pose_width},
                 {"pose_hidden_layers", spec.sdf.pose_hidden_layers},
                 {"kind", to_string(spec.sdf.kind)}};
  json["color"] = {{"width", spec.color.width},     {"hidden_layers", spec.color.hidden_layers},
                   {"skip", spec.color.skip},       {"narrow", spec.color.narrow},
                   {"view", spec.color.view},       {"normal", spec.color.normal},
                   {"feature", spec.color.feature}, {"latent", spec.color.latent},
                   {"directions", to_string(spec.color.directions)}};
  json["latent_size"] = spec.latent_size;
  json["latent_init_std"] = spec.latent_init_std;
  json["b_init"] = spec.b_init;
  json["grid_cells"] = spec.grid_cells;
  return json.dump();
}

AvatarSpec spec_from_json(const std::string& text, const std::string& where) {
  return read_spec(AvatarSpec{}, text, where, true);
}

AvatarSpec spec_with_json(const AvatarSpec& base, const std::string& text, const std::string& where) {
  return read_spec(base, text, where, false);
}

}  // namespace arah
