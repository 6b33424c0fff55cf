#include "viewer/picture_worker.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/body/pose.h"
#include "host/body/shape_space.h"
#include "host/rendering/render_settings.h"

namespace arah {
namespace {

constexpr auto kRest = std::chrono::milliseconds(250);       // without an order, before finer pictures are begun
constexpr auto kBetweenParts = std::chrono::milliseconds(120);  // of a picture that is refined on the screen
constexpr size_t kMostDrawers = 5;  // the presets and one with changed knobs; each holds the avatar's numbers on the device

// On a CPU device some 50 ms of work, so that an order never waits for long; on a GPU these are over in a moment.
constexpr uint32_t kRaysOnCpu = 256;

double since(std::chrono::steady_clock::time_point start) { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); }

// Rows from the top of `to` as in `from`, a picture of the same size. What one of them lacks stays as it is.
void take_rows(Picture& to, const Picture& from, int rows) {
  const auto take = [&](std::vector<float>& into, const std::vector<float>& out, size_t channels) {
    const size_t count = static_cast<size_t>(rows) * static_cast<size_t>(to.width) * channels;
    if (into.size() == out.size() && count <= out.size()) std::copy_n(out.begin(), count, into.begin());
  };
  take(to.color, from.color, 3);
  take(to.alpha, from.alpha, 1);
  take(to.depth, from.depth, 1);
  take(to.normal, from.normal, 3);
  if (!to.inspection || !from.inspection) return;
  const auto count = static_cast<std::ptrdiff_t>(rows) * to.width;
  const auto take_counts = [&](auto& into, const auto& out) { std::copy(out.begin(), out.begin() + count, into.begin()); };
  take_counts(to.inspection->canonical, from.inspection->canonical);
  take_counts(to.inspection->placed, from.inspection->placed);
  take_counts(to.inspection->wanted, from.inspection->wanted);
  take_counts(to.inspection->unfound, from.inspection->unfound);
  take_counts(to.inspection->shaded, from.inspection->shaded);
  take_counts(to.inspection->steps, from.inspection->steps);
  take_counts(to.inspection->most_steps, from.inspection->most_steps);
}

double psnr_of(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += std::pow(double{a[i]} - double{b[i]}, 2);
  return sum > 0 ? -10 * std::log10(sum / static_cast<double>(a.size())) : std::numeric_limits<double>::infinity();
}

}  // namespace

struct PictureWorker::Drawer {
  std::string key;
  std::unique_ptr<Renderer> renderer;
  std::optional<Pose> pose;  // that it drew last
};

PictureWorker::PictureWorker(Device& device, std::shared_ptr<const Avatar> avatar, double frame_seconds, std::function<void()> ready)
    : device_(device), ready_(std::move(ready)), frame_seconds_(frame_seconds), next_avatar_(std::move(avatar)) {
  thread_ = std::thread([this] { run(); });
}

PictureWorker::~PictureWorker() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    ++newest_;  // what is drawn is superseded
  }
  wake_.notify_all();
  thread_.join();
}

uint64_t PictureWorker::order(PictureOrder order) {
  const std::lock_guard lock(mutex_);
  next_ = std::move(order);
  wake_.notify_all();
  return ++newest_;
}

void PictureWorker::set_avatar(std::shared_ptr<const Avatar> avatar) {
  const std::lock_guard lock(mutex_);
  next_avatar_ = std::move(avatar);
  wake_.notify_all();
}

std::optional<DrawnPicture> PictureWorker::take() {
  const std::lock_guard lock(mutex_);
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  return std::exchange(drawn_, std::nullopt);
}

void PictureWorker::start(Job job) {
  const std::lock_guard lock(mutex_);
  if (job_.running) return;
  job_ = {job.name, true, 0, ""};
  job_stopped_ = false;
  next_job_ = std::move(job);
  wake_.notify_all();
}

void PictureWorker::stop_job() {
  const std::lock_guard lock(mutex_);
  job_stopped_ = true;
}

JobState PictureWorker::job() const {
  const std::lock_guard lock(mutex_);
  return job_;
}

void PictureWorker::run_job() {
  std::optional<Job> job;
  {
    const std::lock_guard lock(mutex_);
    job = std::exchange(next_job_, std::nullopt);
  }
  std::string outcome;
  try {
    outcome = job->work(device_, *shown_, [&](double part) {
      const std::lock_guard lock(mutex_);
      job_.part = part;
      return !job_stopped_ && !stopping_;
    });
  } catch (const std::exception& error) {
    outcome = fmt::format("{}: {}", job->name, error.what());
  }
  {
    const std::lock_guard lock(mutex_);
    job_.running = false;
    job_.outcome = std::move(outcome);
    if (!next_) next_ = last_order_;  // whose refinement the job may have ended
  }
  if (ready_) ready_();
}

std::string PictureWorker::doing() const {
  const std::lock_guard lock(mutex_);
  return doing_;
}

bool PictureWorker::superseded(uint64_t number) const {
  const std::lock_guard lock(mutex_);
  return stopping_ || newest_ != number || next_avatar_ || next_job_;
}

void PictureWorker::say(const std::string& doing) {
  const std::lock_guard lock(mutex_);
  doing_ = doing;
}

void PictureWorker::publish(DrawnPicture drawn) {
  {
    const std::lock_guard lock(mutex_);
    drawn_ = std::move(drawn);
  }
  if (ready_) ready_();
}

void PictureWorker::run() {
  for (;;) {
    uint64_t number = 0;
    bool pictures = true;
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [&] { return stopping_ || next_ || (next_avatar_ && last_order_) || (next_job_ && shown_); });
      if (stopping_) break;
      if (next_avatar_) {
        avatar_ = std::exchange(next_avatar_, nullptr);
        drawers_.clear();
        shown_ = std::make_unique<Avatar>(*avatar_);
        moving_.reset();
        last_pose_.reset();
      }
      if (next_) last_order_ = std::exchange(next_, std::nullopt);
      else if (next_job_) pictures = false;
      number = newest_;
    }
    try {
      if (pictures) serve(*last_order_, number);
      else run_job();
    } catch (const RenderingStopped&) {
    } catch (...) {
      drawers_.clear();
      {
        const std::lock_guard lock(mutex_);
        failure_ = std::current_exception();
      }
      if (ready_) ready_();
    }
    say("");
  }
  drawers_.clear();
}

RenderSettings PictureWorker::settings_for(const PictureOrder& order, const Quality& quality) const {
  const bool changed = quality.preset == order.finest && quality.pixel_step == 1;
  RenderSettings settings = preset_with_knobs(*shown_, quality.preset, changed ? order.knobs : std::map<std::string, std::string>{});
  settings.normals = needs_normals(order.layer);
  settings.inspect = needs_inspection(order.layer);
  if (device_.report().type == DeviceType::cpu) settings.most_rays = kRaysOnCpu;
  return settings;
}

PictureWorker::Drawer& PictureWorker::drawer_for(const RenderSettings& settings) {
  const std::string key = render_settings_json(settings) + (settings.normals ? " normals" : "") + (settings.inspect ? " inspection" : "");
  const auto known = std::find_if(drawers_.begin(), drawers_.end(), [&](const Drawer& drawer) { return drawer.key == key; });
  if (known != drawers_.end()) {
    drawers_.splice(drawers_.begin(), drawers_, known);
    return drawers_.front();
  }
  while (drawers_.size() >= kMostDrawers) drawers_.pop_back();
  drawers_.push_front({key, std::make_unique<Renderer>(device_, *shown_, settings), std::nullopt});
  return drawers_.front();
}

std::shared_ptr<const LayerImage> PictureWorker::layer_of(Renderer& renderer, const PictureOrder& order, const Camera& camera, const Picture& picture, const RenderingProgress& progress) const {
  if (order.layer == PictureLayer::weights) return std::make_shared<const LayerImage>(weights_layer(renderer, *shown_, picture, camera, order.pose, order.joint));
  if (order.layer != PictureLayer::slice) return nullptr;
  glm::dvec3 through(0.0);
  const std::vector<glm::vec3> body = posed_vertices(shown_->body, order.pose);
  for (const glm::vec3& vertex : body) through += glm::dvec3(vertex) / double(body.size());
  through -= order.slice * glm::dvec3(camera.R[0][2], camera.R[1][2], camera.R[2][2]);  // the camera looks along its third row
  // Each pixel of it is a search of its own: every second one tells as much.
  const int width = std::max(1, picture.width / 2), height = std::max(1, picture.height / 2);
  return std::make_shared<const LayerImage>(slice_layer(renderer.slice(plane_facing(camera, through), width, height, order.pose, order.latent_row, [&](double part) { return !progress || progress({part, picture, 0}); })));
}

void PictureWorker::draw(const PictureOrder& order, const Quality& quality, const RenderingProgress& progress, DrawnPicture& drawn) {
  Drawer& drawer = drawer_for(settings_for(order, quality));
  device_.profiler().enabled = order.profile && device_.report().timestamp_period_ns > 0;
  device_.profiler().reset();
  const int columns = std::max(1, (order.camera.width + quality.pixel_step - 1) / quality.pixel_step);
  const Camera camera = quality.pixel_step == 1 ? order.camera : order.camera.scaled(columns);
  const double pixels = double(order.camera.width) * order.camera.height;
  const bool new_pose = drawer.pose != order.pose;
  drawer.pose = last_pose_ = order.pose;
  drawer.renderer->reset_work();
  const auto start = Clock::now();
  const auto picture = std::make_shared<const Picture>(drawer.renderer->render(camera, order.pose, order.latent_row, progress));
  if (needs_renderer(order.layer)) drawn.layer = layer_of(*drawer.renderer, order, camera, *picture, progress);
  // What is baked once for a code is not the price of a picture.
  moving_->took(quality, pixels, new_pose, std::max(0.0, since(start) - drawer.renderer->work().baking_seconds));
  drawn.picture = picture;
  drawn.seconds = since(start);
  for (const auto& [stage, statistics] : device_.profiler().stages()) drawn.stages[stage] = statistics.milliseconds;
}

void PictureWorker::serve(const PictureOrder& order, uint64_t number) {
  const std::vector<double>& shape = order.shape.empty() ? avatar_->body.shape.beta : order.shape;
  if (shown_->body.shape.beta != shape) {
    set_shape(shown_->body, shape);
    for (Drawer& drawer : drawers_) {
      drawer.renderer->forget_pose();
      drawer.pose.reset();
    }
    last_pose_.reset();
  }
  if (!moving_) moving_ = std::make_unique<MovingQuality>(*avatar_, frame_seconds_);
  say("drawing");
  const Quality quality = moving_->choose(double(order.camera.width) * order.camera.height, last_pose_ != order.pose, order.finest);
  DrawnPicture drawn;
  drawn.order = number;
  drawn.avatar = avatar_;
  drawn.quality = quality;
  // Not asked whether something newer came: it is short, and the picture must follow the hand.
  draw(order, quality, {}, drawn);
  publish(drawn);
  {
    std::unique_lock lock(mutex_);
    if (wake_.wait_for(lock, kRest, [&] { return stopping_ || next_ || next_avatar_ || next_job_; })) return;
  }
  refine(order, number);
}

void PictureWorker::refine(const PictureOrder& order, uint64_t number) {
  // A slice is the same in all qualities.
  const std::vector<Quality> steps = order.layer == PictureLayer::slice ? std::vector{refinement(*avatar_, order.finest).front()} : refinement(*avatar_, order.finest);
  std::shared_ptr<const Picture> last;
  for (size_t i = 0; i < steps.size(); ++i) {
    say("refining to " + to_string(steps[i]));
    const auto start = Clock::now();
    auto told = start;
    DrawnPicture drawn;
    drawn.order = number;
    drawn.avatar = avatar_;
    drawn.quality = steps[i];
    const auto progress = [&](const PictureSoFar& so_far) {
      if (superseded(number)) return false;
      // With the knob pixel_step what there is so far is smaller: its rows are not the last picture's.
      if (last && (so_far.picture.width != last->width || so_far.picture.height != last->height)) return true;
      if (!last || needs_renderer(order.layer) || so_far.rows == 0 || Clock::now() - told < kBetweenParts) return true;
      told = Clock::now();
      Picture mixed = *last;
      take_rows(mixed, so_far.picture, so_far.rows);
      DrawnPicture part = drawn;
      part.picture = std::make_shared<const Picture>(std::move(mixed));
      part.part = double(so_far.rows) / so_far.picture.height;
      part.seconds = since(start);
      publish(std::move(part));
      return true;
    };
    draw(order, steps[i], progress, drawn);
    last = drawn.picture;
    drawn.finest = i + 1 == steps.size();
    if (drawn.finest && order.compare_with_exact) {
      publish(drawn);
      say("drawing the exact picture");
      DrawnPicture exact;
      draw(order, {"paper", 1}, [&](const PictureSoFar&) { return !superseded(number); }, exact);
      drawn.exact = ExactComparison{psnr_of(exact.picture->color, last->color), exact.seconds};
    }
    publish(std::move(drawn));
  }
}

}  // namespace arah
