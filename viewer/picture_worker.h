// A thread that draws what is asked for, the newest order first, and refines it while nothing new comes.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "host/evaluation/layers.h"
#include "host/rendering/renderer.h"
#include "viewer/quality.h"

namespace arah {

// What is to be seen.
struct PictureOrder {
  Camera camera;
  Pose pose;
  std::size_t latent_row = 0;
  std::vector<double> shape;       // β of the body; empty: the avatar's own
  PictureLayer layer = PictureLayer::color;
  int joint = -1;                  // of the layer weights; -1: all
  double slice = 0;                // of the layer slice: metres from the person's middle towards the camera
  std::string finest = "balanced"; // preset that the picture is refined to at rest
  std::map<std::string, std::string> knobs;  // of that preset, changed (set_render_knob())
  bool profile = false;            // tell times by stage (DrawnPicture::stages), which on a CPU device makes pictures take up to twice as long
  bool compare_with_exact = false; // at rest, the finest picture is also measured against "paper"

  bool operator==(const PictureOrder&) const = default;
};

// How the finest picture differs from the exact one.
struct ExactComparison {
  double psnr = 0;       // dB over the whole picture; infinite where equal
  double seconds = 0;    // that the exact picture took
};

struct DrawnPicture {
  uint64_t order = 0;    // its number
  std::shared_ptr<const Picture> picture;
  std::shared_ptr<const Avatar> avatar;
  std::shared_ptr<const LayerImage> layer;  // of the order, where that needs more than the picture (needs_renderer())
  Quality quality;       // of the rows from the top that are done; below is the last quality
  double part = 1;       // of it, 0..1
  bool finest = false;   // nothing finer follows
  double seconds = 0;    // so far
  std::map<std::string, double> stages;  // milliseconds on the device; with PictureOrder::profile
  std::optional<ExactComparison> exact;
};

// Longer work that needs the device: a video, a mesh. Returns in a few words what became of it. progress: the part done, 0..1;
// false: stop, by throwing RenderingStopped or returning.
struct Job {
  std::string name;
  std::function<std::string(Device&, const Avatar&, const std::function<bool(double)>& progress)> work;
};
struct JobState {
  std::string name;      // empty: there was none yet
  bool running = false;  // or waiting for its turn
  double part = 0;       // done, 0..1
  std::string outcome;   // what work() returned or threw, once it is over
};

class PictureWorker {
 public:
  // frame_seconds: what a picture may take while something moves. ready: called from the worker's thread when there is something to take().
  // The device is the worker's alone from now on, until it is destroyed; its queue may be shared (window_access.h).
  PictureWorker(Device& device, std::shared_ptr<const Avatar> avatar, double frame_seconds, std::function<void()> ready);
  ~PictureWorker();
  PictureWorker(const PictureWorker&) = delete;
  PictureWorker& operator=(const PictureWorker&) = delete;

  // Draws this from now on; returns its number, 1 upwards.
  uint64_t order(PictureOrder order);
  // Another checkpoint of the same person: the last order is drawn anew.
  void set_avatar(std::shared_ptr<const Avatar> avatar);
  // The newest picture that was not taken yet. Throws what drawing threw: InputError for knobs that do not go together, a lost device.
  std::optional<DrawnPicture> take();
  // Does the job when the picture in work is drawn; meanwhile no picture is. One at a time: nothing where one is running.
  void start(Job job);
  void stop_job();
  JobState job() const;
  // In a few words what the worker does ("drawing", "shader …"), empty at rest.
  std::string doing() const;

 private:
  using Clock = std::chrono::steady_clock;
  struct Drawer;  // a renderer with the settings that it was made for

  void run();
  void serve(const PictureOrder& order, uint64_t number);
  void run_job();
  void refine(const PictureOrder& order, uint64_t number);
  bool superseded(uint64_t number) const;
  RenderSettings settings_for(const PictureOrder& order, const Quality& quality) const;
  Drawer& drawer_for(const RenderSettings& settings);
  // The picture, and the layer where it needs the renderer.
  void draw(const PictureOrder& order, const Quality& quality, const RenderingProgress& progress, DrawnPicture& drawn);
  std::shared_ptr<const LayerImage> layer_of(Renderer& renderer, const PictureOrder& order, const Camera& camera, const Picture& picture, const RenderingProgress& progress) const;
  void publish(DrawnPicture drawn);
  void say(const std::string& doing);

  Device& device_;
  std::function<void()> ready_;
  double frame_seconds_;

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool stopping_ = false;
  std::shared_ptr<const Avatar> next_avatar_;
  std::optional<PictureOrder> next_;
  uint64_t newest_ = 0;
  std::optional<DrawnPicture> drawn_;
  std::exception_ptr failure_;
  std::string doing_;
  std::optional<Job> next_job_;
  JobState job_;
  bool job_stopped_ = false;

  // The thread's own.
  std::shared_ptr<const Avatar> avatar_;  // as trained
  std::unique_ptr<Avatar> shown_;         // in the shape that is ordered
  std::list<Drawer> drawers_;             // last used first
  std::unique_ptr<MovingQuality> moving_;
  std::optional<PictureOrder> last_order_;
  std::optional<Pose> last_pose_;         // that was drawn
  std::thread thread_;
};

}  // namespace arah
