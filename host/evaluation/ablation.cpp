#include "host/evaluation/ablation.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "host/avatar/avatar_file.h"
#include "host/evaluation/evaluate.h"
#include "host/evaluation/image_metrics.h"
#include "host/evaluation/picture.h"
#include "host/evaluation/plot.h"
#include "host/file_writing.h"
#include "host/input_error.h"
#include "host/training/run_choice.h"
#include "host/version.h"

namespace arah {
namespace {

using Names = std::vector<std::string>;

// What a capture must have for a variant to say anything.
enum class Wants { anything, several_poses, prior };

struct VariantEntry {
  const char *name, *shows;
  Wants wants;
  Names assignments;
  Names sizes = {};  // of what the presets for CPUs do not have; the preset `paper` keeps its own
};

#define NO_MAPPING "spec.sdf.conditioning=none", "spec.sdf.mapping_width=0", "spec.sdf.mapping_hidden_layers=0"
#define NO_POSE "spec.sdf.pose=none", "spec.sdf.pose_width=0", "spec.sdf.pose_hidden_layers=0"

const std::vector<VariantEntry>& variant_entries() {
  static const std::vector<VariantEntry> entries{
      {"full", "what the capture's choice gives", Wants::anything, {}},
      {"no_conditioning", "one shape for all frames", Wants::anything, {NO_MAPPING, NO_POSE}},
      {"latent", "shape by the frame's code alone", Wants::several_poses, {NO_POSE, "spec.sdf.conditioning=latent"}, {"spec.sdf.mapping_width=64", "spec.sdf.mapping_hidden_layers=2"}},
      {"low_rank", "shape by the pose, low rank", Wants::several_poses, {NO_MAPPING, "spec.sdf.pose=low_rank"}, {"spec.sdf.pose_width=32", "spec.sdf.pose_hidden_layers=1"}},
      {"hypernetwork", "shape by the pose, the paper's hypernetwork", Wants::several_poses, {NO_MAPPING, "spec.sdf.pose=hypernetwork"}, {"spec.sdf.pose_width=64", "spec.sdf.pose_hidden_layers=2"}},
      {"no_latent", "colour without the frame's code", Wants::anything, {"spec.color.latent=false"}},
      {"template_weights", "skinning by the template's nearest vertex", Wants::several_poses, {"spec.skinning.kind=template_weights", "spec.skinning.width=0", "spec.skinning.hidden_layers=0"}},
      {"backward_skinning", "skinning learned in posed space", Wants::several_poses, {"spec.skinning.kind=backward", "sampling_mode=shell", "pose_refinement=false"}},
      {"surface_rendering", "one colour where a ray hits the surface", Wants::anything, {"rendering=surface", "pose_refinement=false"}},
      {"uniform_sampling", "64 samples evenly over the body's box", Wants::anything, {"sampling_mode=uniform", "samples=64"}},
      {"several_starts", "correspondences from three starts", Wants::several_poses, {"root_initialisations=3", "root_correspondence=search"}},
      {"density", "a radiance field without a surface", Wants::anything, {"spec.sdf.kind=density", "sampling_mode=shell"}},
      {"refined_poses", "poses corrected in training", Wants::several_poses, {"pose_refinement=true"}},
      {"prior", "a start from many bodies", Wants::prior, {}},
  };
  return entries;
}

#undef NO_MAPPING
#undef NO_POSE

// Why such a capture cannot show it; empty where it can.
std::string why_not(const VariantEntry& entry, const CaptureFacts& facts, const std::string& prior) {
  if (entry.wants == Wants::prior && prior.empty()) return "no --prior was given";
  if (entry.wants == Wants::several_poses && (facts.single_pose || facts.training_frames <= 1)) return "all frames show one pose";
  if (entry.wants == Wants::several_poses && facts.joints <= 1) return "the body has one joint";
  return "";
}

RunConfig ablated(const RunConfig& full, const VariantEntry& entry, const std::string& prior) {
  const auto makes = [&](const char* assignment) { return std::find(entry.assignments.begin(), entry.assignments.end(), assignment) != entry.assignments.end(); };
  Names assignments = entry.assignments;
  if (full.settings.preset != "paper") assignments.insert(assignments.end(), entry.sizes.begin(), entry.sizes.end());
  // Without a reader there are no codes.
  const bool color = full.spec.color.latent && !makes("spec.color.latent=false");
  const bool shape = makes("spec.sdf.conditioning=latent") || (full.spec.sdf.conditioning == SdfConditioning::latent && !makes("spec.sdf.conditioning=none"));
  if (!color && !shape) assignments.push_back("spec.latent_size=0");
  RunConfig config = full;
  assign(config, assignments, entry.name);
  if (entry.wants == Wants::prior) config.settings.prior = prior;
  search_for_refinement(config.settings);
  check_settings(config.settings, config.spec, entry.name);
  return config;
}

bool same_training(const RunConfig& a, const RunConfig& b) { return a.spec == b.spec && settings_to_json(a.settings) == settings_to_json(b.settings); }

// Whose pictures of a split are compared; empty where it has none.
std::string compared_cameras(const Capture& capture, const std::string& split) {
  bool any = false;
  for (size_t camera = 0; camera < capture.cameras.size(); ++camera) {
    if (frames_with_images(capture, split, camera).empty()) continue;
    if (capture.cameras[camera].role == "test") return "held-out";
    any = true;
  }
  return any && split != "train" ? "all" : "";
}

std::vector<EvaluationSettings> compared_splits(const Capture& capture, const AblationSettings& settings) {
  std::vector<EvaluationSettings> splits;
  const auto add = [&](const std::string& split) {
    const std::string cameras = compared_cameras(capture, split);
    if (cameras.empty()) return;
    EvaluationSettings one;
    one.split = split;
    one.cameras = cameras;
    one.every = settings.every;
    one.size = settings.size;
    one.pictures = false;
    splits.push_back(one);
  };
  for (const char* split : {"train", "novel"}) if (capture.motions.contains(split)) add(split);
  for (const auto& [split, motion] : capture.motions) if (split != "train" && split != "novel" && split != "ood") add(split);
  if (capture.motions.contains("ood")) add("ood");
  return splits;
}

// The picture that stands for a variant; absent where no split has one.
struct ShownPicture {
  std::string split;
  EvaluationPlace place;
  Camera camera;
};

std::optional<ShownPicture> shown_picture(const Capture& capture, const AblationSettings& settings) {
  const std::vector<EvaluationSettings> splits = compared_splits(capture, settings);
  if (splits.empty()) return {};
  const EvaluationSettings& hardest = splits.back();
  std::vector<EvaluationPlace> places;
  for (size_t camera = 0; camera < capture.cameras.size(); ++camera)
    if (hardest.cameras == "all" || capture.cameras[camera].role == "test")
      for (const int frame : frames_with_images(capture, hardest.split, camera)) places.push_back({camera, frame});
  const EvaluationPlace place = places[places.size() / 2];
  const Camera& stored = capture.cameras[place.camera];
  return ShownPicture{hardest.split, place, settings.size > 0 ? stored.scaled(settings.size) : stored};
}

std::vector<uint8_t> png_of(const std::vector<float>& rgb, const Camera& camera) { return encode_png(rgb, camera.width, camera.height, 3); }

std::optional<double> optional_of(const nlohmann::ordered_json& value) { return value.is_number() ? std::optional(value.get<double>()) : std::nullopt; }
nlohmann::ordered_json json_of(const std::optional<double>& value) { return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json(); }

// A column of figures, in every form of the table.
struct FigureColumn {
  std::string key, title;  // in the CSV, elsewhere
  int digits = 0;
  int better = 0;  // 1: more is, -1: less is, 0: neither
  std::function<std::optional<double>(const AblationRow&)> of;
};

std::vector<FigureColumn> figure_columns(const AblationTable& table) {
  std::vector<FigureColumn> columns;
  if (!table.rows.empty()) {
    for (size_t s = 0; s < table.rows.front().splits.size(); ++s) {
      const std::string split = table.rows.front().splits[s].split;
      columns.push_back({"psnr_" + split, split + ", dB", 2, 1, [s](const AblationRow& row) { return row.splits.at(s).psnr; }});
      columns.push_back({"ssim_" + split, split + ", SSIM", 4, 1, [s](const AblationRow& row) { return row.splits.at(s).ssim; }});
    }
  }
  columns.push_back({"surface_mm", "surface, mm", 2, -1, [](const AblationRow& row) { return row.surface ? std::optional(1e3 * *row.surface) : std::nullopt; }});
  columns.push_back({"found_percent", "found, %", 2, 0, [](const AblationRow& row) { return row.found ? std::optional(100 * *row.found) : std::nullopt; }});
  columns.push_back({"least_found_percent", "least, %", 2, 0, [](const AblationRow& row) { return row.least_found ? std::optional(100 * *row.least_found) : std::nullopt; }});
  columns.push_back({"steps", "steps", 0, 0, [](const AblationRow& row) { return std::optional(double(row.steps)); }});
  columns.push_back({"seconds_per_step", "s/step", 3, 0, [](const AblationRow& row) { return row.seconds_per_step > 0 ? std::optional(row.seconds_per_step) : std::nullopt; }});
  columns.push_back({"learned_numbers", "learned numbers", 0, 0, [](const AblationRow& row) { return std::optional(double(row.learned_numbers)); }});
  columns.push_back({"device_mb", "device, MB", 1, 0, [](const AblationRow& row) { return std::optional(1e-6 * double(row.device_bytes)); }});
  return columns;
}

std::string figure_text(const FigureColumn& column, const AblationRow& row, const char* absent) {
  const std::optional<double> value = column.of(row);
  return value ? fmt::format("{:.{}f}", *value, column.digits) : absent;
}

bool is_best(const FigureColumn& column, const AblationTable& table, const AblationRow& row) {
  const std::optional<double> value = column.of(row);
  return column.better != 0 && value && std::none_of(table.rows.begin(), table.rows.end(), [&](const AblationRow& other) {
    const std::optional<double> theirs = column.of(other);
    return theirs && column.better * (*theirs - *value) > 0;
  });
}

}  // namespace

std::vector<std::string> ablation_names() {
  Names names;
  for (const VariantEntry& entry : variant_entries()) names.push_back(entry.name);
  return names;
}

Ablation ablation(const RunConfig& full, const CaptureFacts& facts, const std::string& prior, const Names& only) {
  const Names names = ablation_names();
  for (const std::string& name : only)
    if (std::find(names.begin(), names.end(), name) == names.end()) throw InputError("--only", "", fmt::format("some of {}", fmt::join(names, ", ")), "'" + name + "'");
  Ablation result;
  for (const VariantEntry& entry : variant_entries()) {
    if (!only.empty() && std::find(only.begin(), only.end(), entry.name) == only.end()) continue;
    std::string reason = why_not(entry, facts, prior);
    if (reason.empty()) {
      AblationVariant variant{entry.name, entry.shows, ablated(full, entry, prior)};
      const auto same = std::find_if(result.variants.begin(), result.variants.end(), [&](const AblationVariant& other) { return same_training(other.config, variant.config); });
      if (same == result.variants.end()) result.variants.push_back(std::move(variant));
      else reason = fmt::format("the same training as {}", same->name);
    }
    if (!reason.empty()) result.left_out.emplace_back(entry.name, reason);
  }
  return result;
}

AblationRow measure_variant(Device& device, const Capture& capture, const AblationVariant& variant, const RunFolder& folder, const AblationSettings& settings,
                            const std::function<bool(double)>& progress) {
  using nlohmann::ordered_json;
  const Avatar avatar = load_avatar(folder.avatar_file());
  const std::vector<EvaluationSettings> splits = compared_splits(capture, settings);
  const std::optional<RunEnd> end = run_end(folder);
  AblationRow row;
  row.name = variant.name;
  row.shows = variant.shows;
  row.steps = avatar.steps;
  row.learned_numbers = avatar.layout.parameter_count();
  if (end) row.seconds_per_step = end->seconds_per_step, row.device_bytes = end->most_memory;

  const std::filesystem::path figures = folder.config_file().parent_path() / "measured.json", picture = folder.config_file().parent_path() / "measured.png";
  ordered_json of{{"version", kVersion}, {"fingerprint", variant.config.fingerprint}, {"steps", avatar.steps}, {"seconds", end ? end->seconds : 0.0}, {"every", settings.every}, {"size", settings.size}, {"splits", ordered_json::array()}};
  for (const EvaluationSettings& split : splits) of["splits"].push_back(split.split);
  const auto read = [](const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  const ordered_json before = ordered_json::parse(read(figures), nullptr, false);
  if (before.is_object() && before.value("of", ordered_json()) == of) {
    for (const ordered_json& one : before.at("figures")) row.splits.push_back({one.at("split"), optional_of(one.at("psnr")), optional_of(one.at("ssim"))});
    row.surface = optional_of(before.at("surface"));
    row.found = optional_of(before.at("found"));
    row.least_found = optional_of(before.at("least_found"));
    const std::string png = read(picture);
    row.rendering.assign(png.begin(), png.end());
    return row;
  }

  RootFindingCounts counts;
  ordered_json written = ordered_json::array();
  for (size_t s = 0; s < splits.size(); ++s) {
    const Evaluation one = evaluate(device, avatar, capture, splits[s], [&](double part) { return !progress || progress((double(s) + part) / double(splits.size() + 1)); });
    // A mean over other pictures than the rest of the table's is none.
    row.splits.push_back({splits[s].split == "train" ? "views" : splits[s].split, one.unmeasured ? std::nullopt : one.psnr, one.unmeasured ? std::nullopt : one.ssim});
    written.push_back({{"split", row.splits.back().split}, {"psnr", json_of(one.psnr)}, {"ssim", json_of(one.ssim)}});
    counts.points += one.root_finding.points;
    counts.converged += one.root_finding.converged;
    if (const auto least = least_found(one)) row.least_found = std::min(*least, row.least_found.value_or(1));
  }
  if (counts.points > 0) row.found = double(counts.converged) / double(counts.points);
  if (avatar.spec.sdf.kind == FieldKind::sdf && avatar.spec.skinning.kind != Skinning::backward) {
    std::vector<SurfaceError> errors;
    for (const auto& [split, motion] : capture.motions) {
      if (!has_surface(capture, split)) continue;
      const std::vector<SurfaceError> some = surface_errors(device, avatar, capture, split);
      errors.insert(errors.end(), some.begin(), some.end());
    }
    double sum = 0;
    for (const SurfaceError& error : errors) sum += error.mean;
    if (!errors.empty()) row.surface = sum / double(errors.size());
  }
  if (const auto shown = shown_picture(capture, settings)) {
    const MotionFrame& frame = *find_frame(motion_of(capture, shown->split), shown->place.frame);
    Renderer renderer(device, avatar, render_preset(avatar, "paper"));
    row.rendering = png_of(renderer.render(shown->camera, pose_to_render(avatar.refined, shown->split, frame), avatar.spec.latent_size > 0 ? latent_row(avatar, frame.number) : 0).color, shown->camera);
    write_file_safely(picture, row.rendering);
  }
  write_file_safely(figures, ordered_json{{"of", of}, {"figures", written}, {"surface", json_of(row.surface)}, {"found", json_of(row.found)}, {"least_found", json_of(row.least_found)}}.dump(1) + "\n");
  return row;
}

void add_photograph(AblationTable& table, const Capture& capture, const AblationSettings& settings) {
  const auto shown = shown_picture(capture, settings);
  if (!shown) return;
  table.photograph = png_of(rgb_on_black(load_image(capture, shown->split, shown->place.camera, shown->place.frame, settings.size)), shown->camera);
  table.picture = fmt::format("{}, {}, frame {}", shown->split, shown->camera.name, shown->place.frame);
}

std::string ablation_csv(const AblationTable& table) {
  const std::vector<FigureColumn> columns = figure_columns(table);
  std::string text = "variant";
  for (const FigureColumn& column : columns) text += "," + column.key;
  text += "\n";
  for (const AblationRow& row : table.rows) {
    text += row.name;
    for (const FigureColumn& column : columns) text += "," + figure_text(column, row, "");
    text += "\n";
  }
  return text;
}

std::string ablation_markdown(const AblationTable& table) {
  const std::vector<FigureColumn> columns = figure_columns(table);
  std::string text = "| variant | what it is |", rule = "|---|---|";
  for (const FigureColumn& column : columns) text += " " + column.title + " |", rule += "---:|";
  text += "\n" + rule + "\n";
  for (const AblationRow& row : table.rows) {
    text += fmt::format("| `{}` | {} |", row.name, row.shows);
    for (const FigureColumn& column : columns) {
      const char* mark = is_best(column, table, row) ? "**" : "";
      text += fmt::format(" {}{}{} |", mark, figure_text(column, row, "–"), mark);
    }
    text += "\n";
  }
  for (const auto& [name, reason] : table.left_out) text += fmt::format("\n`{}` is left out: {}.\n", name, reason);
  return text;
}

std::string ablation_text(const AblationTable& table) {
  const std::vector<FigureColumn> columns = figure_columns(table);
  std::string text = fmt::format("{:18}", "variant");
  for (const FigureColumn& column : columns) text += fmt::format("  {:>12}", column.title);
  text += "\n";
  for (const AblationRow& row : table.rows) {
    text += fmt::format("{:18}", row.name);
    for (const FigureColumn& column : columns) text += fmt::format("  {:>{}}", figure_text(column, row, "-"), std::max<size_t>(12, column.title.size()));
    text += "\n";
  }
  return text;
}

std::string ablation_page(const AblationTable& table, const Capture& capture, const Device& device) {
  const std::vector<FigureColumn> columns = figure_columns(table);
  std::string page = page_start("Ablations");
  page += fmt::format("<p class=\"quiet\">{} on {} ({}), arah {}.</p>\n<div class=\"scroll\"><table class=\"wide\"><tr><th class=\"left\">variant</th><th class=\"left words\">what it is</th>",
                      escape_html(capture.path.filename().string()), escape_html(device.report().name), escape_html(device.report().driver), kVersion);
  for (const FigureColumn& column : columns) page += "<th>" + escape_html(column.title) + "</th>";
  page += "</tr>\n";
  for (const AblationRow& row : table.rows) {
    page += fmt::format("<tr><td class=\"left\">{}</td><td class=\"left words\">{}</td>", escape_html(row.name), escape_html(row.shows));
    for (const FigureColumn& column : columns) {
      const std::string text = figure_text(column, row, "–");
      page += is_best(column, table, row) ? "<td><b>" + text + "</b></td>" : "<td>" + text + "</td>";
    }
    page += "</tr>\n";
  }
  page += "</table></div>\n<p class=\"quiet\">" + escape_html(metrics_definition()) +
          " views: held-out cameras, the training's frames. surface: mean distance of the true surface's vertices, hair left out. found: of the correspondences that the pictures' samples needed; least: in the picture with the least. device: most memory in buffers.</p>\n";
  for (const auto& [name, reason] : table.left_out) page += fmt::format("<p class=\"quiet\">{} is left out: {}.</p>\n", escape_html(name), escape_html(reason));
  if (!table.photograph.empty()) {
    page += "<h2>" + escape_html(table.picture) + "</h2>\n<div class=\"pictures\">" + figure_html({"photograph", table.photograph}, table.picture);
    for (const AblationRow& row : table.rows) page += figure_html({row.name, row.rendering}, table.picture);
    page += "</div>\n";
  }
  return page + "</main></body></html>\n";
}

}  // namespace arah
