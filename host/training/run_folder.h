// A training on the disk:
//   config.json         what is trained, and on which capture; whole before anything else is there
//   events.jsonl        what happened, one JSON object a line, appended
//   checkpoints/step_<8 digits>.safetensors   the newest two: everything that continuing needs
//   avatar.safetensors  the newest avatar
//   kept/minutes_<minutes>.safetensors   avatars of its way, where they were asked for
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host/avatar/avatar_spec.h"
#include "host/avatar/safetensors.h"
#include "host/capture/capture.h"
#include "host/folder_lock.h"
#include "host/training/training_settings.h"

namespace arah {

struct RunConfig {
  TrainingSettings settings;
  AvatarSpec spec;
  std::filesystem::path capture;
  std::string fingerprint;  // of the capture, capture_fingerprint()
  // What that capture is made of, capture_parts(); empty in runs of earlier versions.
  std::map<std::string, std::string> parts;
};

// 16 hexadecimal digits: FNV-1a over cameras.json, motion_train.json and template.glb, each with its length. Pictures
// are not read. Throws InputError naming a file that cannot be read.
std::string capture_fingerprint(const Capture& capture);

// What training reads of a capture, each with what tells it from another: its three files with their FNV-1a, and each training
// camera's folder of pictures, "images/train/cam_00", with their count and FNV-1a over their names, sizes and last 32 bytes,
// where PNG has the checksum of all pixels (Adler-32 at the end of the compressed stream, PNG specification, chapter 10).
// Throws InputError naming a file that cannot be read.
std::map<std::string, std::string> capture_parts(const Capture& capture);

// Makes it the capture of `config`: its place, fingerprint and parts. Throws as these do.
void set_capture(RunConfig& config, const Capture& capture);

RunConfig make_run_config(const Capture& capture, const TrainingSettings& settings, const AvatarSpec& spec);

// An avatar after so many minutes of training.
struct KeptAvatar {
  double minutes = 0;
  std::filesystem::path file;
};

class RunFolder {
 public:
  explicit RunFolder(std::filesystem::path path) : path_(std::move(path)) {}

  std::filesystem::path config_file() const { return path_ / "config.json"; }
  std::filesystem::path events_file() const { return path_ / "events.jsonl"; }
  std::filesystem::path avatar_file() const { return path_ / "avatar.safetensors"; }

  std::filesystem::path kept_file(double minutes) const;
  // The checkpoint of before a step that was not taken because of bad values (bad_values.h).
  std::filesystem::path failure_file(uint64_t step) const;
  // By minutes; none where none were kept.
  std::vector<KeptAvatar> kept_avatars() const;

  // Makes the folder with its config.json and holds it against other writers (FolderLock) until this object is gone. A folder with
  // nothing in it but what a killed process left unfinished counts as empty. Throws InputError where it exists and is not empty,
  // or is held by another.
  void create(const RunConfig& config);
  // Throws InputError: no such folder, no config.json, a field that is missing or wrong.
  RunConfig read_config() const;
  // Only settings.steps, settings.minutes, settings.on_bad_value and the capture's place may differ from what config.json holds; throws InputError
  // naming the first other difference: of a capture the file or the pictures that changed.
  void check_continues(const RunConfig& config) const;
  // Makes `config` the one of a run that goes on, and holds the folder as create() does. Throws as check_continues(), and where
  // another holds the folder. Removes what a killed process left unfinished: files on their way, a line of events.jsonl.
  void reopen(const RunConfig& config);
  // Takes back create(): removes what a run writes, and the folder if create() made it.
  void discard();

  // Appends one line; `json` is one object in text. Throws std::runtime_error where the disk refuses.
  void log(const std::string& json) const;

  // Writes the checkpoint of that step, safely, and removes all but the newest two, as far as they can be removed.
  std::filesystem::path save_checkpoint(uint64_t step, const SafetensorsFile& file) const;
  // The newest checkpoint that holds an avatar and its optimiser; absent where there is no checkpoint at all. Newer ones that
  // do not open are passed over, `damaged` says why, a line each. Throws InputError where there are some and none opens.
  std::optional<SafetensorsFile> newest_checkpoint(std::vector<std::string>* damaged = nullptr) const;

 private:
  std::filesystem::path checkpoints() const { return path_ / "checkpoints"; }
  std::vector<std::filesystem::path> checkpoint_files() const;  // newest first
  void remove_unfinished() const;

  std::filesystem::path path_;
  std::shared_ptr<const FolderLock> lock_;
  bool made_ = false;
};

// A "step" line of events.jsonl.
struct LoggedStep {
  uint64_t step = 0;
  double seconds = 0;  // of training until then, earlier calls included
  double color = 0;    // unweighted colour loss
  double total = 0;    // weighted sum
};

// The "end" line of events.jsonl, with what the steps before it tell.
struct RunEnd {
  uint64_t step = 0;
  double seconds = 0;           // of training
  double seconds_per_step = 0;  // between the first and the last line of a step; 0 where there is one alone
  bool stopped = false;         // before the end
  uint64_t most_memory = 0;     // bytes on the device
};

// Absent where the run has not ended yet, or was started again since.
std::optional<RunEnd> run_end(const RunFolder& folder);

// In the order of the file; lines of another kind, or that a killed process left unfinished, are passed over.
std::vector<LoggedStep> logged_steps(const RunFolder& folder);

}  // namespace arah
