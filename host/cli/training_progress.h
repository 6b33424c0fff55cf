// A training on the terminal: a bar for the template fit, a bar for the steps, a line for what happens between.
#pragma once

#include <optional>
#include <string>

#include "host/cli/progress.h"
#include "host/training/training_run.h"

namespace arah {

class TrainingProgress {
 public:
  // device: whose memory is summed up once the trainer stands. budget: how long it takes, such as "10 minutes".
  TrainingProgress(const Device& device, std::string budget) : device_(device), budget_(std::move(budget)) {}

  void show(const RunEvent& event);
  // The last line, with what came of it.
  void finish(const RunResult& result);

 private:
  const Device& device_;
  std::string budget_;
  std::optional<Progress> fit_, steps_;
  StepReport last_;
};

}  // namespace arah
