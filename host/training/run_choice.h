// What a run is to be: the capture's choice of parts, and settings that are assigned by name ("NAME=VALUE").
#pragma once

#include <string>
#include <vector>

#include "host/training/run_folder.h"

namespace arah {

// A preset's settings and the parts of it that the capture needs. reasons: filled with SpecChoice::reasons where given. Throws as
// choose_spec() and capture_facts() do.
RunConfig chosen_config(const Capture& capture, const std::string& preset, std::vector<std::string>* reasons = nullptr);

// The JSON with one field replaced by "NAME=VALUE"; a field within a group is called "sdf.rate". VALUE is JSON, or else a
// text. Throws InputError naming `option` for what is no assignment (with `example`) or no field.
std::string with_field(const std::string& text, const std::string& assignment, const char* option, const char* example);

// Settings by their names, parts of the avatar as "spec.sdf.width=96"; all are made before any is checked, since one may need another.
// Throws InputError naming `option` for what is no assignment, no field or not a value that it takes.
void assign(RunConfig& config, const std::vector<std::string>& assignments, const char* option);

// Throws InputError naming --size where the settings want larger pictures than a training camera has.
void check_size(const TrainingSettings& settings, const Capture& capture);

}  // namespace arah
