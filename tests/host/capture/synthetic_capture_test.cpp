// A capture of an invented subject must be as good as a recorded one: it opens, its parts fit each other, and it
// repeats.
#include "host/capture/synthetic_capture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "host/capture/capture.h"
#include "host/capture/software_renderer.h"
#include "host/capture/figure_anatomy.h"
#include "host/capture/synthetic_figure.h"
#include "host/capture/synthetic_motion.h"
#include "host/input_error.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

SyntheticSettings settings_of(int frames, int size, std::uint64_t seed = 0, const fs::path& rig = {}) {
  return {rig, frames, size, seed};
}

// A folder of the test's own, gone with it.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    path = fs::temp_directory_path() / fmt::format("arah_{}_{}_{}", test->test_suite_name(), test->name(), getpid());
    fs::remove_all(path);
    fs::create_directories(path);
  }
  ~TemporaryFolder() { fs::remove_all(path); }
  fs::path path;
};

std::map<std::string, std::string> files_of(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    std::ifstream file(entry.path(), std::ios::binary);
    files[fs::relative(entry.path(), folder).string()] = {std::istreambuf_iterator<char>(file), {}};
  }
  return files;
}

const ClothedFigure& standard_figure() {
  static const ClothedFigure figure = make_clothed_figure(0);
  return figure;
}

// The share of the template's posed vertices that fall on the figure or on a neighbouring pixel, the worst over all
// pictures.
double worst_share_on_figure(const Capture& capture) {
  double worst = 1;
  for (const auto& [split, motion] : capture.motions)
    for (std::size_t camera = 0; camera < capture.cameras.size(); ++camera)
      for (const int number : frames_with_images(capture, split, camera)) {
        const Image image = load_image(capture, split, camera, number);
        const auto covered = [&](int x, int y) {
          if (x < 0 || y < 0 || x >= image.width || y >= image.height) return false;
          return image.rgba[4 * static_cast<std::size_t>(y * image.width + x) + 3] > 0;
        };
        std::size_t on_figure = 0;
        const std::vector<glm::vec3> vertices = posed_vertices(capture.body_template, find_frame(motion, number)->pose);
        for (const glm::vec3& vertex : vertices) {
          const glm::dvec2 pixel = capture.cameras[camera].project(glm::dvec3(vertex));
          const int x = static_cast<int>(std::lround(pixel.x)), y = static_cast<int>(std::lround(pixel.y));
          bool near = false;
          for (int dy = -1; dy <= 1; ++dy)
            for (int dx = -1; dx <= 1; ++dx) near = near || covered(x + dx, y + dy);
          on_figure += near ? 1 : 0;
        }
        worst = std::min(worst, static_cast<double>(on_figure) / static_cast<double>(vertices.size()));
      }
  return worst;
}

// Directed edges that have not as many partners in the other direction: none in a mesh that is closed and consistently
// oriented. And the volume within, m^3, positive where normals point outward.
std::pair<std::size_t, double> open_edges_and_volume(const BodyTemplate& body) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  double volume = 0;
  for (const glm::uvec3& t : body.triangles) {
    for (int k = 0; k < 3; ++k) ++uses[{t[k], t[(k + 1) % 3]}];
    volume += static_cast<double>(glm::dot(body.vertices[t.x], glm::cross(body.vertices[t.y], body.vertices[t.z]))) / 6;
  }
  std::size_t open_edges = 0;
  for (const auto& [edge, count] : uses) {
    const auto back = uses.find({edge.second, edge.first});
    open_edges += back == uses.end() || back->second != count ? 1 : 0;
  }
  return {open_edges, volume};
}

TEST(SyntheticFigure, BodyIsClosedAndSkinnedBySmplsTree) {
  for (const std::uint64_t seed : {0, 1, 7}) {
    const BodyTemplate body = make_clothed_figure(seed).body;
    EXPECT_NO_THROW(validate_skeleton(body.skeleton, "figure"));
    EXPECT_EQ(body.skeleton.size(), 24u);
    EXPECT_TRUE(has_smpl_legs(body.skeleton));
    EXPECT_GE(body.vertices.size(), 8000u);
    EXPECT_LE(body.vertices.size(), 16000u);
    const auto [open_edges, volume] = open_edges_and_volume(body);
    EXPECT_EQ(open_edges, 0u) << "seed " << seed;
    EXPECT_GT(volume, 0.045) << "m^3: a person of 45 to 95 kg, normals outward";
    EXPECT_LT(volume, 0.095);
    std::set<int> moved;
    for (std::size_t i = 0; i < body.weights.size(); ++i) {
      EXPECT_NEAR(body.weights[i].x + body.weights[i].y + body.weights[i].z + body.weights[i].w, 1.0f, 1e-5f);
      moved.insert(body.joints[i].x);
    }
    EXPECT_EQ(moved.size(), 24u) << "every joint moves some skin most";
  }
}

// FNV-1a over the bytes of a figure's body and clothes.
class FigureHash {
 public:
  template <typename T>
  void add(const std::vector<T>& values) {
    const auto* bytes = reinterpret_cast<const unsigned char*>(values.data());
    for (std::size_t i = 0; i < values.size() * sizeof(T); ++i) hash_ = (hash_ ^ bytes[i]) * 0x100000001b3ull;
  }
  static std::uint64_t of(const ClothedFigure& figure) {
    FigureHash hash;
    hash.add(figure.body.skeleton.rest_joints);
    hash.add(figure.body.vertices);
    hash.add(figure.body.triangles);
    hash.add(figure.body.weights);
    hash.add(figure.rest);
    hash.add(figure.weights);
    hash.add(figure.triangles);
    hash.add(figure.looseness);
    return hash.hash_;
  }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325ull;
};

// Captures and stored losses of earlier versions were made from these bits.
TEST(SyntheticFigure, TheFiguresOfEarlierVersionsStayAsTheyAre) {
  EXPECT_EQ(FigureHash::of(standard_figure()), 7668680745302646868ull);
  EXPECT_EQ(FigureHash::of(make_clothed_figure(7)), 8951744011960758094ull);
}

// Of a family each body is another one, and as good a body as the average.
TEST(SyntheticFigure, VariedFiguresDifferAndAreWholeBodies) {
  std::set<std::uint64_t> hashes;
  std::set<double> heights;
  std::set<std::set<FigureLayer>> wardrobes;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const ClothedFigure figure = make_clothed_figure(0, varied_figure(seed));
    const BodyTemplate& body = figure.body;
    EXPECT_NO_THROW(validate_skeleton(body.skeleton, "figure"));
    EXPECT_EQ(body.skeleton.names, standard_figure().body.skeleton.names);
    EXPECT_EQ(body.skeleton.parents, standard_figure().body.skeleton.parents);
    const auto [open_edges, volume] = open_edges_and_volume(body);
    EXPECT_EQ(open_edges, 0u) << "seed " << seed;
    EXPECT_GT(volume, 0.03) << "seed " << seed;
    EXPECT_LT(volume, 0.13) << "seed " << seed;
    float lowest = 9, highest = 0;
    std::set<int> moved;
    for (std::size_t i = 0; i < body.vertices.size(); ++i) {
      const glm::vec4& w = body.weights[i];
      EXPECT_NEAR(w.x + w.y + w.z + w.w, 1.0f, 1e-5f);
      moved.insert(body.joints[i].x);
      lowest = std::min(lowest, body.vertices[i].y), highest = std::max(highest, body.vertices[i].y);
    }
    EXPECT_EQ(moved.size(), 24u) << "seed " << seed;
    EXPECT_NEAR(lowest, 0.0f, 0.02f) << "it stands on the ground";
    EXPECT_GT(highest, 1.4f);
    EXPECT_LT(highest, 2.1f);
    ASSERT_EQ(figure.under_cloth.size(), figure.rest.size());
    const auto under = static_cast<double>(std::count(figure.under_cloth.begin(), figure.under_cloth.end(), 1));
    EXPECT_LT(under, 0.5 * static_cast<double>(figure.rest.size()));
    hashes.insert(FigureHash::of(figure));
    heights.insert(highest);
    wardrobes.insert(std::set<FigureLayer>(figure.layers.begin(), figure.layers.end()));
  }
  EXPECT_EQ(hashes.size(), 8u);
  EXPECT_EQ(heights.size(), 8u);
  EXPECT_GE(wardrobes.size(), 2u) << "not all wear the same";
  EXPECT_TRUE(hashes.contains(FigureHash::of(make_clothed_figure(0, varied_figure(3))))) << "the same seed, the same bits";
  EXPECT_EQ(FigureHash::of(make_clothed_figure(0, varied_figure(0))), FigureHash::of(standard_figure()));
}

TEST(SyntheticFigure, StretchAndItsInverseCancel) {
  Build build;
  build.arm_length = 1.2, build.leg_length = 0.8, build.trunk_length = 1.1;
  const Stretch stretch(build);
  for (double x = -0.9; x < 0.95; x += 0.1)
    for (double y = 0; y < 1.8; y += 0.05) {
      const glm::dvec3 place(x, y, 0.1), back = stretch.to_average(stretch.from_average(place));
      for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(back[axis], place[axis], 1e-12) << x << ' ' << y;
    }
  // Hip to ankle is as much shorter as asked, shoulder to wrist as much longer.
  EXPECT_NEAR(stretch.from_average({0, 0.875, 0}).y - stretch.from_average({0, 0.085, 0}).y, 0.8 * 0.79, 1e-12);
  EXPECT_NEAR(stretch.from_average({-0.68, 1, 0}).x - stretch.from_average({-0.18, 1, 0}).x, -1.2 * 0.5, 1e-12);
}

TEST(SyntheticFigure, ClothesMoveBeyondSkinningAndSkinDoesNot) {
  const ClothedFigure& figure = standard_figure();
  double sum = 0, largest = 0;
  std::size_t garment_vertices = 0;
  for (const double seconds : {0.4, 1.7, 3.1, 4.9}) {
    const Pose pose = synthetic_pose(figure, SyntheticSplit::kTrain, seconds, 0);
    const Pose before = synthetic_pose(figure, SyntheticSplit::kTrain, seconds - 0.03, 0);
    const PosedSurface posed = pose_surface(figure, pose, before, 0.03);
    const std::vector<glm::vec3> skinned = skinned_surface(figure, pose);
    for (std::size_t i = 0; i < skinned.size(); ++i) {
      const double deviation = static_cast<double>(glm::distance(posed.positions[i], skinned[i]));
      EXPECT_NEAR(glm::length(posed.normals[i]), 1.0f, 1e-4f);
      if (figure.layers[i] != FigureLayer::kShirt && figure.layers[i] != FigureLayer::kShorts) {
        ASSERT_EQ(deviation, 0.0) << "vertex " << i;
        continue;
      }
      sum += deviation;
      largest = std::max(largest, deviation);
      ++garment_vertices;
    }
  }
  const double mean = sum / static_cast<double>(garment_vertices);
  std::printf("  garment against skinning: mean %.1f mm, largest %.1f mm\n", 1000 * mean, 1000 * largest);
  EXPECT_GT(mean, 0.004);
  EXPECT_LT(mean, 0.020);
  EXPECT_LT(largest, 0.060);
}

TEST(SyntheticFigure, AtRestClothesHangAsTheyWereMade) {
  const ClothedFigure& figure = standard_figure();
  Pose standing = rest_pose(figure.body.skeleton);
  standing.theta[0] = {std::acos(0.0), 0, 0};  // from +Y up to +Z up
  const PosedSurface posed = pose_surface(figure, standing, standing, 0.1);
  const std::vector<glm::vec3> skinned = skinned_surface(figure, standing);
  for (std::size_t i = 0; i < skinned.size(); ++i)
    ASSERT_LT(glm::distance(posed.positions[i], skinned[i]), 1e-5f) << "vertex " << i;
}

TEST(SyntheticMotion, StandsOnTheGroundAndMovesSmoothly) {
  const ClothedFigure& figure = standard_figure();
  for (const SyntheticSplit split : {SyntheticSplit::kTrain, SyntheticSplit::kNovel}) {
    std::vector<glm::vec3> before;
    for (double seconds = 0; seconds <= kSyntheticMotionSeconds + 0.2; seconds += 0.05) {
      const std::vector<glm::vec3> now = skinned_surface(figure, synthetic_pose(figure, split, seconds, 3));
      float lowest = 1e9f, fastest = 0;
      for (std::size_t i = 0; i < now.size(); ++i) {
        lowest = std::min(lowest, now[i].z);
        if (!before.empty()) fastest = std::max(fastest, glm::distance(now[i], before[i]) / 0.05f);
      }
      EXPECT_NEAR(lowest, 0.0f, 1e-4f) << seconds << " s";
      EXPECT_LT(fastest, 6.0f) << "m/s at " << seconds << " s";
      before = now;
    }
  }
  const Pose train = synthetic_pose(figure, SyntheticSplit::kTrain, 1.0, 3),
             novel = synthetic_pose(figure, SyntheticSplit::kNovel, 1.0, 3);
  EXPECT_NE(train.theta, novel.theta);
}

Camera front_camera(int width, int height) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.K = glm::dmat3(1.0);
  camera.K[0][0] = camera.K[1][1] = 20;
  camera.K[2] = {0.5 * (width - 1), 0.5 * (height - 1), 1};
  return camera;
}

TEST(SoftwareRenderer, CoversWhatProjectsAndHidesWhatIsBehind) {
  const Camera camera = front_camera(31, 17);
  // A near red square of 6 pixels around the centre, half of column 12 included, and a far green one twice as wide.
  const std::vector<glm::vec3> positions = {{-.15f, -.15f, 1}, {.15f, -.15f, 1}, {.15f, .15f, 1}, {-.15f, .15f, 1},
                                            {-.6f, -.6f, 2},   {.6f, -.6f, 2},   {.6f, .6f, 2},   {-.6f, .6f, 2},
                                            {-.1f, -.1f, -1},  {.1f, -.1f, -1},  {.1f, .1f, -1}};
  const std::vector<glm::uvec3> triangles = {{4, 5, 6}, {4, 6, 7}, {0, 1, 2}, {0, 2, 3}, {8, 9, 10}};
  const RgbaPicture picture = rasterise(camera, positions, triangles, [](const SurfaceSample& sample) {
    EXPECT_NE(sample.triangle, 4u) << "behind the camera";
    return sample.triangle >= 2 ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0);
  });
  const auto pixel = [&](int x, int y) {
    const std::uint8_t* p = &picture.rgba[4 * static_cast<std::size_t>(y * 31 + x)];
    return std::vector<int>{p[0], p[1], p[2], p[3]};
  };
  EXPECT_THAT(pixel(15, 8), testing::ElementsAre(255, 0, 0, 255));
  EXPECT_THAT(pixel(15, 3), testing::ElementsAre(0, 255, 0, 255));
  EXPECT_THAT(pixel(20, 8), testing::ElementsAre(0, 255, 0, 255));
  EXPECT_THAT(pixel(15, 0), testing::ElementsAre(0, 0, 0, 0));
  EXPECT_THAT(pixel(22, 8), testing::ElementsAre(0, 0, 0, 0));
  // The far square's edge runs through the centres of column 9: its middle and right samples are covered; the colour
  // stays full.
  EXPECT_THAT(pixel(9, 8), testing::ElementsAre(0, 255, 0, 170));
}

TEST(SoftwareRenderer, BarycentricCoordinatesAreThoseInSpace) {
  const Camera camera = front_camera(33, 21);
  const std::vector<glm::vec3> positions = {{-1, -.7f, 1.5f}, {2.5f, -.2f, 4}, {-.4f, 3.1f, 7}};
  const std::vector<glm::uvec3> triangles = {{0, 1, 2}};
  int samples = 0;
  rasterise(camera, positions, triangles, [&](const SurfaceSample& sample) {
    const glm::vec3& w = sample.barycentric;
    const glm::vec3 point = w.x * positions[0] + w.y * positions[1] + w.z * positions[2];
    // The point must lie on the grid of samples, three to a pixel.
    const glm::dvec2 place = camera.project(glm::dvec3(point)) * 3.0;
    EXPECT_NEAR(place.x, std::round(place.x), 1e-3);
    EXPECT_NEAR(place.y, std::round(place.y), 1e-3);
    ++samples;
    return glm::vec3(0.5f);
  });
  EXPECT_GT(samples, 500);
}

TEST(SyntheticCapture, OpensAndFitsItsTemplate) {
  const TemporaryFolder folder;
  const fs::path out = folder.path / "subject";
  double last = -1;
  write_synthetic_capture(out, settings_of(7, 64, 5), [&](double fraction, const std::string&) {
    EXPECT_GE(fraction, 0.0);
    EXPECT_LE(fraction, 1.0);
    last = std::max(last, fraction);
  });
  EXPECT_EQ(last, 1.0);
  EXPECT_FALSE(fs::exists(folder.path / "subject.partial"));
  const Capture capture = open_capture(out);
  ASSERT_EQ(capture.cameras.size(), 8u);
  for (std::size_t c = 0; c < 8; ++c) {
    EXPECT_EQ(capture.cameras[c].role, c < 4 ? "train" : "test");
    const auto train = frames_with_images(capture, "train", c);
    if (c < 4) {
      EXPECT_THAT(train, testing::ElementsAre(0, 1, 2, 3, 4, 5, 6));
    } else {
      EXPECT_THAT(train, testing::ElementsAre(0, 6));
    }
    EXPECT_THAT(frames_with_images(capture, "novel", c), testing::ElementsAre(7, 8));
  }
  EXPECT_TRUE(fs::exists(out / "meshes/train_000000.ply"));
  EXPECT_TRUE(fs::exists(out / "meshes/novel_000007.ply"));
  EXPECT_GE(worst_share_on_figure(capture), 0.98);
}

TEST(SyntheticCapture, TheSeedDecidesEveryByte) {
  const TemporaryFolder folder;
  const SyntheticSettings settings = settings_of(4, 48, 11);
  write_synthetic_capture(folder.path / "a", settings);
  write_synthetic_capture(folder.path / "b/", settings);
  const auto first = files_of(folder.path / "a");
  EXPECT_EQ(first.size(), 4u * 4 + 4 + 8 + 2 + 5) << "pictures, meshes, and five files beside";
  EXPECT_EQ(first, files_of(folder.path / "b"));
  write_synthetic_capture(folder.path / "b", settings_of(4, 48, 12));
  const auto other = files_of(folder.path / "b");
  ASSERT_EQ(other.size(), first.size()) << "an earlier synthetic capture is replaced";
  for (const auto& [name, bytes] : first) EXPECT_NE(bytes, other.at(name)) << name;
}

TEST(SyntheticCapture, TheBodySeedChangesTheBodyAndFitsItsTemplate) {
  const TemporaryFolder folder;
  SyntheticSettings settings = settings_of(2, 64);
  write_synthetic_capture(folder.path / "a", settings);
  settings.body_seed = 4;
  write_synthetic_capture(folder.path / "b", settings);
  EXPECT_NE(files_of(folder.path / "a").at("template.glb"), files_of(folder.path / "b").at("template.glb"));
  EXPECT_GE(worst_share_on_figure(open_capture(folder.path / "b")), 0.98);
}

// A unit of a morph target is the body that the figure's own makers give such a build: joints exactly, vertices as the nearest
// of that body's mesh, which is another.
TEST(SyntheticCapture, TheTemplatesShapeIsTheFiguresBuild) {
  const FigureVariation variation = varied_figure(4);
  const ClothedFigure figure = make_clothed_figure(3, variation);
  BodyTemplate body = body_with_shape(figure, variation.build);
  EXPECT_EQ(body.shape.names, (std::vector<std::string>{"height", "arm_length", "leg_length", "trunk_length"}));
  EXPECT_EQ(body.vertices, figure.body.vertices);
  for (std::size_t b = 0; b < 4; ++b) {
    SCOPED_TRACE(body.shape.names[b]);
    FigureVariation other = variation;
    (b == 0 ? other.build.height : b == 1 ? other.build.arm_length : b == 2 ? other.build.leg_length : other.build.trunk_length) *= 1.1;
    const BodyTemplate truth = make_body(make_anatomy(3, other));
    std::vector<double> beta(4, 0.0);
    beta[b] = 1;
    set_shape(body, beta);
    for (std::size_t j = 0; j < truth.skeleton.size(); ++j) EXPECT_LT(glm::length(body.skeleton.rest_joints[j] - truth.skeleton.rest_joints[j]), 1e-9) << truth.skeleton.names[j];
    float farthest = 0, before = 0;
    for (std::size_t v = 0; v < body.vertices.size(); v += 37) {
      const auto nearest = [&](const glm::vec3& place) {
        float least = 1;
        for (const glm::vec3& vertex : truth.vertices) least = std::min(least, glm::distance(vertex, place));
        return least;
      };
      farthest = std::max(farthest, nearest(body.vertices[v]));
      before = std::max(before, nearest(body.shape.base_vertices[v]));
    }
    std::printf("  %s: vertices up to %.1f mm from the other body's, %.1f mm without the target\n", body.shape.names[b].c_str(), 1e3 * double(farthest), 1e3 * double(before));
    EXPECT_LT(farthest, 0.5f * before);
  }
}

TEST(SyntheticCapture, AnyRigCanBeTheBody) {
  const TemporaryFolder folder;
  // A box of 4 cm with two joints that no one has heard of.
  BodyTemplate box;
  box.skeleton = {{"base", "lid"}, {-1, 0}, {{0, 0, 0}, {0, 0.02, 0}}};
  for (int corner = 0; corner < 8; ++corner) {
    const glm::vec3 place(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
    box.vertices.push_back(0.04f * place - glm::vec3(0.02f, 0, 0.02f));
    box.normals.push_back(glm::normalize(place - 0.5f));
    box.joints.emplace_back(place.y > 0 ? 1 : 0, 0, 0, 0);
    box.weights.emplace_back(1, 0, 0, 0);
  }
  box.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                   {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  write_body_template(folder.path / "box.glb", box);
  write_body_template(folder.path / "person.glb", standard_figure().body);
  for (const char* rig : {"box", "person"}) {
    const fs::path out = folder.path / rig;
    write_synthetic_capture(out, settings_of(3, 64, 0, folder.path / (std::string(rig) + ".glb")));
    const Capture capture = open_capture(out);
    EXPECT_EQ(capture.body_template.skeleton.names,
              rig == std::string("box") ? box.skeleton.names : standard_figure().body.skeleton.names);
    EXPECT_GE(worst_share_on_figure(capture), 0.98) << rig;
    bool garment = false;
    for (const FigureLayer layer : dress_rig(capture.body_template).layers) garment = garment || layer == FigureLayer::kRigGarment;
    EXPECT_TRUE(garment) << rig;
  }
}

template <typename Action>
std::string message_of(Action action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "no InputError";
}

TEST(SyntheticCapture, RefusesWhatItCannotDo) {
  const TemporaryFolder folder;
  const fs::path out = folder.path / "out";
  const auto attempt = [&](const fs::path& where, const SyntheticSettings& settings) {
    return message_of([&] { write_synthetic_capture(where, settings); });
  };
  EXPECT_THAT(attempt(out, settings_of(0, 64)), testing::HasSubstr("frames: expected 1 to 10000, found 0"));
  EXPECT_THAT(attempt(out, settings_of(4, 15)), testing::HasSubstr("size: expected 16 to 4096, found 15"));
  EXPECT_THAT(attempt(out, settings_of(4, 64, 0, folder.path / "none.glb")), testing::HasSubstr("none.glb"));
  SyntheticSettings both = settings_of(4, 64, 0, folder.path / "some.glb");
  both.body_seed = 1;
  EXPECT_THAT(attempt(out, both), testing::HasSubstr("body_seed: expected 0 with a rig"));
  EXPECT_THAT(attempt("", {}), testing::HasSubstr("expected a name"));
  EXPECT_FALSE(fs::exists(out));

  std::ofstream(folder.path / "file") << "x";
  EXPECT_THAT(attempt(folder.path / "file", {}), testing::HasSubstr("expected a folder"));
  fs::create_directories(out);
  std::ofstream(out / "thesis.txt") << "mine";
  EXPECT_THAT(attempt(out, {}), testing::HasSubstr("found other files"));
  EXPECT_EQ(files_of(out), (std::map<std::string, std::string>{{"thesis.txt", "mine"}}));
}

TEST(SyntheticCapture, ReplacesWhatAKilledRunLeftButNothingElse) {
  const TemporaryFolder folder;
  const fs::path out = folder.path / "out", partial = folder.path / "out.partial";
  fs::create_directories(partial);
  std::ofstream(partial / "thesis.txt") << "mine";
  EXPECT_THAT(message_of([&] { write_synthetic_capture(out, settings_of(1, 16)); }), testing::HasSubstr("out.partial"));
  EXPECT_TRUE(fs::exists(partial / "thesis.txt"));
  std::ofstream(partial / "synthetic.json") << "{}";
  write_synthetic_capture(out, settings_of(1, 16));
  EXPECT_FALSE(fs::exists(partial));
  EXPECT_FALSE(fs::exists(out / "thesis.txt"));
  EXPECT_EQ(open_capture(out).motions.at("novel").frames.size(), 1u);
}

}  // namespace
}  // namespace arah
