#include "host/training/run_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>

#include "host/avatar/avatar_file.h"
#include "host/body/json_fields.h"
#include "host/file_writing.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr std::size_t kKeptCheckpoints = 2;
constexpr const char* kPrefix = "step_";
constexpr const char* kSuffix = ".safetensors";
constexpr const char* kKeptPrefix = "minutes_";

std::string read_text(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file || fs::is_directory(path)) throw InputError(path.string(), "", "a file", "none that can be opened");
  return {std::istreambuf_iterator<char>(file), {}};
}

std::string config_text(const RunConfig& config) {
  const ordered_json json{
      {"capture", fs::absolute(config.capture).lexically_normal().string()},
      {"capture_fingerprint", config.fingerprint},
      {"capture_parts", config.parts},
      {"spec", ordered_json::parse(spec_to_json(config.spec))},
      {"settings", ordered_json::parse(settings_to_json(config.settings))},
  };
  return json.dump(2) + "\n";
}

// Path of the first place where two JSON values differ, such as "sdf.rate"; empty where they are equal.
std::string first_difference(const nlohmann::json& a, const nlohmann::json& b, const std::string& path = "") {
  if (a == b) return "";
  if (a.is_object() && b.is_object()) {
    for (const auto& [name, value] : a.items()) {
      const std::string here = path.empty() ? name : path + "." + name;
      if (!b.contains(name)) return here;
      const std::string below = first_difference(value, b[name], here);
      if (!below.empty()) return below;
    }
  }
  return path.empty() ? "/" : path;
}

nlohmann::json at_path(nlohmann::json value, const std::string& path) {
  for (std::size_t from = 0; from <= path.size();) {
    const std::size_t to = std::min(path.find('.', from), path.size());
    const std::string name = path.substr(from, to - from);
    if (!value.is_object() || !value.contains(name)) break;
    value = nlohmann::json(value[name]);
    from = to + 1;
  }
  return value;
}

void require_equal(const std::string& where, const std::string& part, const std::string& before_text,
                   const std::string& now_text) {
  const auto before = nlohmann::json::parse(before_text), now = nlohmann::json::parse(now_text);
  const std::string field = first_difference(before, now);
  if (field.empty()) return;
  throw InputError(where, part + "." + field, "what the run began with, " + json_excerpt(at_path(before, field)),
                   json_excerpt(at_path(now, field)), "Leave the option out, or begin another run.");
}

constexpr std::array kCaptureFiles{"cameras.json", "motion_train.json", "template.glb"};

class Fnv1a {
 public:
  // A text with its length.
  void add(const std::string& text) {
    const uint64_t size = text.size();
    add(&size, sizeof size);
    add(text.data(), text.size());
  }
  std::string text() const { return fmt::format("{:016x}", hash_); }

 private:
  void add(const void* data, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i)
      hash_ = (hash_ ^ static_cast<const unsigned char*>(data)[i]) * 0x100000001b3ull;
  }
  uint64_t hash_ = 0xcbf29ce484222325ull;
};

// Of a PNG: Adler-32 of all pixels, CRC of their chunk, and the last chunk of 12 bytes.
constexpr std::streamoff kPictureEnd = 32;

std::string picture_end(const fs::path& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = file.tellg();
  std::string end(static_cast<std::size_t>(std::clamp(size, std::streamoff{0}, kPictureEnd)), '\0');
  file.seekg(-static_cast<std::streamoff>(end.size()), std::ios::end);
  if (!file.read(end.data(), static_cast<std::streamsize>(end.size()))) throw InputError(path.string(), "", "a picture", "none that can be read");
  return fmt::format("{} bytes ", size) + end;
}

// Removes the files that write_file_safely() left in `folder` under way to a name that begins with `name`.
void remove_on_the_way(const fs::path& folder, const std::string& name) {
  std::error_code ignored;  // what cannot be removed is in nobody's way
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    const std::string found = entry.path().filename().string();
    if (found.starts_with("." + name) && found.ends_with(".part")) fs::remove(entry.path(), ignored);
  }
}

}  // namespace

std::string capture_fingerprint(const Capture& capture) {
  Fnv1a hash;
  for (const char* name : kCaptureFiles) hash.add(read_text(capture.path / name));
  return hash.text();
}

std::map<std::string, std::string> capture_parts(const Capture& capture) {
  std::map<std::string, std::string> parts;
  for (const char* name : kCaptureFiles) {
    Fnv1a hash;
    hash.add(read_text(capture.path / name));
    parts[name] = hash.text();
  }
  for (std::size_t camera = 0; camera < capture.cameras.size(); ++camera) {
    if (capture.cameras[camera].role != "train") continue;
    const std::vector<int> frames = frames_with_images(capture, "train", camera);
    Fnv1a hash;
    for (const int frame : frames) {
      const fs::path picture = image_path(capture, "train", camera, frame);
      hash.add(picture.filename().string());
      hash.add(picture_end(picture));
    }
    parts["images/train/" + capture.cameras[camera].name] = fmt::format("{} pictures {}", frames.size(), hash.text());
  }
  return parts;
}

void set_capture(RunConfig& config, const Capture& capture) {
  config.capture = capture.path;
  config.fingerprint = capture_fingerprint(capture);
  config.parts = capture_parts(capture);
}

RunConfig make_run_config(const Capture& capture, const TrainingSettings& settings, const AvatarSpec& spec) {
  RunConfig config{settings, spec, {}, {}, {}};
  set_capture(config, capture);
  return config;
}

void RunFolder::create(const RunConfig& config) {
  if (fs::exists(path_)) {
    if (!fs::is_directory(path_)) throw InputError(path_.string(), "", "a folder", "a file", "Choose another name.");
  }
  std::error_code error;
  made_ = fs::create_directories(path_, error);
  if (error) throw InputError(fmt::format("{}: could not be made: {}. Choose a folder that takes files.", path_.string(), error.message()));
  lock_ = std::make_shared<FolderLock>(path_);
  remove_on_the_way(path_, config_file().filename().string());
  if (!fs::is_empty(path_))
    throw InputError(path_.string(), "", "a new or empty folder", "one with files in it",
                     "--resume continues a run; otherwise choose another name.");
  write_file_safely(config_file(), config_text(config));
}

RunConfig RunFolder::read_config() const {
  const std::string where = config_file().string();
  if (!fs::is_regular_file(config_file()))
    throw InputError(path_.string(), "", "a run's folder with config.json",
                     fs::exists(path_) ? "none" : "no such folder", "arah train without --resume begins a run.");
  const nlohmann::json json = read_json(config_file());
  const auto text = [&](const char* name) {
    const nlohmann::json& value = json_member(json, name, where, "");
    if (!value.is_string()) throw InputError(where, name, "a text", json_excerpt(value));
    return value.get<std::string>();
  };
  RunConfig config;
  config.capture = text("capture");
  config.fingerprint = text("capture_fingerprint");
  if (json.contains("capture_parts")) {  // not in runs of earlier versions
    const nlohmann::json& parts = json["capture_parts"];
    const bool texts = parts.is_object() && std::all_of(parts.begin(), parts.end(), [](const nlohmann::json& part) { return part.is_string(); });
    if (!texts) throw InputError(where, "capture_parts", "an object of texts", json_excerpt(parts));
    config.parts = parts.get<std::map<std::string, std::string>>();
  }
  config.spec = spec_from_json(json_member(json, "spec", where, "").dump(), where + ": spec");
  config.settings = settings_from_json(json_member(json, "settings", where, "").dump(), where + ": settings");
  return config;
}

void RunFolder::check_continues(const RunConfig& config) const {
  RunConfig before = read_config();
  const std::string where = config_file().string();
  const std::string advice = "A run continues on the capture that it began with: bring that back, or begin another run.";
  if (!before.parts.empty() && before.parts != config.parts) {
    std::map<std::string, std::string> all = before.parts;
    all.insert(config.parts.begin(), config.parts.end());
    for (const auto& [name, either] : all) {
      const auto part_of = [part = name](const std::map<std::string, std::string>& parts) { return parts.contains(part) ? parts.at(part) : std::string("none"); };
      const std::string expected = part_of(before.parts), found = part_of(config.parts);
      if (expected != found)
        throw InputError((config.capture / name).string(), "", fmt::format("what {} began with ({})", path_.string(), expected), fmt::format("another ({})", found), advice);
    }
  }
  if (before.fingerprint != config.fingerprint)
    throw InputError(where, "capture_fingerprint", before.fingerprint + " (" + before.capture.string() + ")",
                     config.fingerprint + " (" + config.capture.string() + ")",
                     advice);
  require_equal(where, "spec", spec_to_json(before.spec), spec_to_json(config.spec));
  before.settings.steps = config.settings.steps;
  before.settings.minutes = config.settings.minutes;
  before.settings.on_bad_value = config.settings.on_bad_value;
  require_equal(where, "settings", settings_to_json(before.settings), settings_to_json(config.settings));
}

void RunFolder::remove_unfinished() const {
  for (const fs::path& file : {config_file(), avatar_file()}) remove_on_the_way(path_, file.filename().string());
  remove_on_the_way(checkpoints(), kPrefix);
  remove_on_the_way(path_ / "kept", kKeptPrefix);
}

void RunFolder::reopen(const RunConfig& config) {
  lock_ = std::make_shared<FolderLock>(path_);
  check_continues(config);
  remove_unfinished();
  write_file_safely(config_file(), config_text(config));

  if (!fs::is_regular_file(events_file())) return;
  const std::string events = read_text(events_file());
  const std::size_t end = events.rfind('\n');
  const std::size_t whole = end == std::string::npos ? 0 : end + 1;
  if (whole < events.size()) fs::resize_file(events_file(), whole);
}

fs::path RunFolder::kept_file(double minutes) const { return path_ / "kept" / fmt::format("{}{:g}{}", kKeptPrefix, minutes, kSuffix); }

std::vector<KeptAvatar> RunFolder::kept_avatars() const {
  std::vector<KeptAvatar> kept;
  if (!fs::is_directory(path_ / "kept")) return kept;
  for (const auto& entry : fs::directory_iterator(path_ / "kept")) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(kKeptPrefix) || !name.ends_with(kSuffix)) continue;
    kept.push_back({std::atof(name.c_str() + std::string_view(kKeptPrefix).size()), entry.path()});
  }
  std::sort(kept.begin(), kept.end(), [](const KeptAvatar& a, const KeptAvatar& b) { return a.minutes < b.minutes; });
  return kept;
}

void RunFolder::discard() {
  std::error_code ignored;  // what cannot be removed is whole, and another start names it
  fs::remove_all(checkpoints(), ignored);
  fs::remove_all(path_ / "kept", ignored);
  for (const fs::path& file : {avatar_file(), events_file(), config_file()}) fs::remove(file, ignored);
  if (made_) fs::remove(path_, ignored);
}

void RunFolder::log(const std::string& json) const {
  std::ofstream file(events_file(), std::ios::app | std::ios::binary);
  file << json << '\n' << std::flush;
  if (!file)
    throw std::runtime_error(fmt::format("{}: could not be written: {}", events_file().string(), std::strerror(errno)));
}

std::vector<fs::path> RunFolder::checkpoint_files() const {
  std::vector<fs::path> files;
  if (!fs::is_directory(checkpoints())) return files;
  for (const auto& entry : fs::directory_iterator(checkpoints())) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(kPrefix) && name.ends_with(kSuffix)) files.push_back(entry.path());
  }
  // Eight digits or more: a longer name is a later step.
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    const std::string x = a.filename().string(), y = b.filename().string();
    return x.size() != y.size() ? x.size() > y.size() : x > y;
  });
  return files;
}

fs::path RunFolder::save_checkpoint(uint64_t step, const SafetensorsFile& file) const {
  std::error_code error;
  fs::create_directories(checkpoints(), error);
  if (error) throw InputError(fmt::format("{}: could not be made: {}. Choose a folder that takes files.", checkpoints().string(), error.message()));
  const fs::path path = checkpoints() / fmt::format("{}{:08}{}", kPrefix, step, kSuffix);
  write_safetensors(path, file);
  const std::vector<fs::path> files = checkpoint_files();
  // What cannot be removed does no harm; a folder that takes no change at all is named by the next file or line that goes there.
  std::error_code ignored;
  for (std::size_t i = kKeptCheckpoints; i < files.size(); ++i) fs::remove(files[i], ignored);
  return path;
}

fs::path RunFolder::failure_file(uint64_t step) const { return path_ / fmt::format("failure_{:08}{}", step, kSuffix); }

std::optional<SafetensorsFile> RunFolder::newest_checkpoint(std::vector<std::string>* damaged) const {
  const std::vector<fs::path> files = checkpoint_files();
  std::string reason;
  for (const fs::path& path : files) {
    try {
      SafetensorsFile file = read_safetensors(path);
      avatar_from_tensors(file);
      file.at("optimizer.parameters");
      return file;
    } catch (const InputError& error) {
      if (reason.empty()) reason = error.what();
      if (damaged) damaged->push_back(error.what());
    }
  }
  if (files.empty()) return std::nullopt;
  throw InputError(checkpoints().string(), "", "a checkpoint that opens", "none: " + reason,
                   "Remove them to begin again from the template.");
}

namespace {

// What a line of events.jsonl says; null where it is cut off or no JSON.
nlohmann::json event_of(const std::string& line) {
  try {
    const nlohmann::json json = parse_json(line, "events.jsonl");
    return json.is_object() ? json : nlohmann::json();
  } catch (const InputError&) {
    return {};
  }
}

double number_of(const nlohmann::json& event, const char* name) {
  const auto found = event.find(name);
  return found != event.end() && found->is_number() ? found->get<double>() : 0.0;
}
uint64_t count_of(const nlohmann::json& event, const char* name) {
  const auto found = event.find(name);
  return found != event.end() && found->is_number_unsigned() ? found->get<uint64_t>() : 0;
}

}  // namespace

std::optional<RunEnd> run_end(const RunFolder& folder) {
  std::optional<RunEnd> end;
  std::ifstream file(folder.events_file());
  for (std::string line; std::getline(file, line);) {
    const nlohmann::json json = event_of(line);
    if (!json.is_object()) continue;
    const nlohmann::json event = json.value("event", nlohmann::json());
    if (event == "start") end.reset();
    if (event == "end") end = RunEnd{count_of(json, "step"), number_of(json, "seconds"), 0, json.value("stopped", nlohmann::json(true)) != false, count_of(json, "most_memory")};
  }
  if (!end) return end;
  const std::vector<LoggedStep> steps = logged_steps(folder);
  if (!steps.empty() && steps.back().step > steps.front().step)
    end->seconds_per_step = (steps.back().seconds - steps.front().seconds) / double(steps.back().step - steps.front().step);
  return end;
}

std::vector<LoggedStep> logged_steps(const RunFolder& folder) {
  std::vector<LoggedStep> steps;
  std::ifstream file(folder.events_file());
  for (std::string line; std::getline(file, line);) {
    const nlohmann::json json = event_of(line);
    if (!json.is_object() || json.value("event", nlohmann::json()) != "step") continue;
    steps.push_back({count_of(json, "step"), number_of(json, "seconds"), number_of(json, "color"), number_of(json, "total")});
  }
  return steps;
}

}  // namespace arah
