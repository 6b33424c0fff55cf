#include <functional>
#include <glm/matrix.hpp>
#include <nlohmann/json.hpp>

#include "tests/host/body/hostile_json.h"
#include "tests/host/body/memory_of_refusal.h"
#include "tests/host/capture/small_capture.h"

namespace arah {
namespace {

TEST(Camera, RaysGoThroughWhatTheyProjectTo) {
  const Camera camera = odd_camera();
  for (const glm::dvec2 pixel : {glm::dvec2(0.0, 0.0), glm::dvec2(36.0, 22.0), glm::dvec2(-5.5, 11.25)}) {
    const PixelRay ray = camera.ray(pixel.x, pixel.y);
    EXPECT_NEAR(glm::length(ray.direction), 1.0, 1e-14);
    EXPECT_LT(glm::length(ray.origin - camera.center()), 1e-14);
    for (double distance : {0.01, 2.0, 1e4}) {
      const glm::dvec3 point = ray.origin + distance * ray.direction;
      EXPECT_GT(camera.to_camera(point).z, 0.0);
      EXPECT_LT(glm::length(camera.project(point) - pixel), 1e-9) << distance;
    }
  }
}

TEST(Camera, ScalesAboutPixelCorners) {
  const Camera camera = odd_camera();
  const glm::dvec3 point = camera.ray(20.0, 9.0).origin + 2.0 * camera.ray(20.0, 9.0).direction;
  for (int width : {1, 10, 37, 74, 500}) {
    const Camera scaled = camera.scaled(width);
    const glm::dvec2 pixel = scaled.project(point);
    EXPECT_NEAR((pixel.x + 0.5) / scaled.width, 20.5 / 37.0, 1e-12) << width;
    EXPECT_NEAR((pixel.y + 0.5) / scaled.height, 9.5 / 23.0, 1e-12) << width;
  }
  EXPECT_EQ(camera.scaled(74).height, 46);
  EXPECT_EQ(camera.scaled(1).height, 1);
  EXPECT_THROW(camera.scaled(0), std::invalid_argument);
}

TEST(Camera, DistortsAsOpenCvDocumentsIt) {
  Camera camera = front_camera("d", 100, 80);
  camera.K = {50.0, 0.0, 0.0, 0.0, 40.0, 0.0, 49.5, 39.5, 1.0};
  camera.distortion = {0.1, 0.01, 0.002, -0.003, 0.0005};
  // x = 1, y = 0.5: r² = 1.25, radial = 1 + 0.125 + 0.015625 + 0.0005·1.953125.
  const double radial = 1.140625 + 0.0005 * 1.953125;
  const double x = radial + 2.0 * 0.002 * 0.5 - 0.003 * (1.25 + 2.0);
  const double y = 0.5 * radial + 0.002 * (1.25 + 0.5) - 2.0 * 0.003 * 0.5;
  const glm::dvec2 pixel = camera.distort({99.5, 59.5});
  EXPECT_NEAR(pixel.x, 50.0 * x + 49.5, 1e-12);
  EXPECT_NEAR(pixel.y, 40.0 * y + 39.5, 1e-12);
  camera.distortion = {};
  EXPECT_FALSE(camera.distorted());
  EXPECT_LT(glm::length(camera.distort({3.0, 70.0}) - glm::dvec2(3.0, 70.0)), 1e-12);
}

TEST(Cameras, ReadBackExactly) {
  const TemporaryFolder folder;
  std::vector<Camera> cameras = {odd_camera(), front_camera("b", 8192, 1)};
  cameras[0].distortion[3] = 1e-3;
  cameras[1].role = "test";
  write_cameras(folder / "cameras.json", cameras);
  const std::vector<Camera> back = read_cameras(folder / "cameras.json");
  ASSERT_EQ(back.size(), 2u);
  for (std::size_t c = 0; c < 2; ++c) {
    EXPECT_EQ(back[c].name, cameras[c].name);
    EXPECT_EQ(back[c].role, cameras[c].role);
    EXPECT_EQ(back[c].width, cameras[c].width);
    EXPECT_EQ(back[c].height, cameras[c].height);
    EXPECT_EQ(back[c].K, cameras[c].K);
    EXPECT_EQ(back[c].R, cameras[c].R);
    EXPECT_EQ(back[c].T, cameras[c].T);
    EXPECT_EQ(back[c].distortion, cameras[c].distortion);
  }
}

TEST(Cameras, ThatAreHeldOutAreForTests) {
  const TemporaryFolder folder;
  Camera camera = odd_camera();
  camera.role = "heldout";
  write_cameras(folder / "cameras.json", {camera});
  EXPECT_EQ(read_cameras(folder / "cameras.json")[0].role, "test");
}

TEST(Cameras, NameTheCameraThatIsWrong) {
  const TemporaryFolder folder;
  write_cameras(folder / "good.json", {odd_camera(), front_camera("b", 40, 30)});
  std::ifstream file(folder / "good.json");
  const nlohmann::json good = nlohmann::json::parse(file);
  using nlohmann::json;
  const std::vector<std::pair<std::function<void(json*)>, std::vector<std::string>>> cases = {
      {[](json* c) { (*c)["R"][0][0] = 1.01; }, {"'b' R", "rotation", "off by"}},
      {[](json* c) {
         (*c)["R"] = {{1, 0, 0}, {0, 1, 0}, {0, 0, -1}};
       },
       {"'b' R", "determinant +1", "mirror"}},
      {[](json* c) {
         (*c)["R"] = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}};
       },
       {"'b' R", "rotation"}},
      {[](json* c) { (*c)["R"][2].erase(0); }, {"'b' R", "3 values", "2"}},
      {[](json* c) { (*c)["K"][1][1] = -60; }, {"'b' K", "positive focal lengths", "-60"}},
      {[](json* c) {
         (*c)["K"][2] = {0, 0, 0};
       },
       {"'b' K", "[0, 0, 1]"}},
      {[](json* c) { (*c)["T"][1] = nullptr; }, {"'b' T", "finite", "null"}},
      {[](json* c) { c->erase("T"); }, {"'b' T", "none"}},
      {[](json* c) { (*c)["width"] = 0; }, {"'b' width", "1 to 8192", "0"}},
      {[](json* c) { (*c)["height"] = 8193; }, {"'b' height", "8193"}},
      {[](json* c) {
         (*c)["D"] = {0, 0, 0, 0};
       },
       {"'b' D", "5 values"}},
      {[](json* c) { (*c)["role"] = "spare"; }, {"'b' role", "'spare'"}},
      {[](json* c) { (*c)["role"] = 3; }, {"'b' role", "a text", "3"}},
      {[](json* c) { (*c)["name"] = "odd"; }, {"'odd'", "twice"}},
      {[](json* c) { (*c)["name"] = "../b"; }, {"cameras[1] name", "folder"}},
      {[](json* c) { c->erase("name"); }, {"cameras[1] name", "none"}},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    json changed = good;
    cases[i].first(&changed["cameras"][1]);
    const std::filesystem::path path = folder.write("bad.json", changed.dump());
    expect_input_error([&] { read_cameras(path); }, cases[i].second);
  }
  // Nested ten thousand deep, where nothing reads it and where a number is expected.
  for (const std::string& deep : {nested_lists(10'000), nested_objects(10'000)}) {
    for (const std::string& text : {deep, "{\"cameras\":" + deep + "}", "{\"cameras\":[{\"name\":\"a\",\"width\":" + deep + "}]}"}) {
      const std::filesystem::path path = folder.write("deep.json", text);
      expect_input_error([&] { read_cameras(path); }, {"deep.json", "nested at most 64 deep"});
      EXPECT_LT(memory_of_refusal([&] { read_cameras(path); }), kMostMemoryOfRefusal);
    }
  }
  expect_input_error([&] { read_cameras(folder.write("none.json", R"({"cameras": []})")); }, {"at least one camera"});
  expect_input_error([&] { read_cameras(folder / "absent.json"); }, {"absent.json", "none that can be opened"});
}

// Whether the pixel's ray meets the vertices' box grown by `margin` (slab test).
bool meets_box(const Camera& camera, double u, double v, const std::vector<glm::vec3>& vertices, double margin) {
  glm::dvec3 least(vertices[0]), greatest(vertices[0]);
  for (const glm::vec3& vertex : vertices) {
    least = glm::min(least, glm::dvec3(vertex));
    greatest = glm::max(greatest, glm::dvec3(vertex));
  }
  const PixelRay ray = camera.ray(u, v);
  double near = 0.0, far = 1e9;
  for (int k = 0; k < 3; ++k) {
    const double a = (least[k] - margin - ray.origin[k]) / ray.direction[k];
    const double b = (greatest[k] + margin - ray.origin[k]) / ray.direction[k];
    near = std::max(near, std::min(a, b));
    far = std::min(far, std::max(a, b));
  }
  return near <= far;
}

TEST(BoxMask, CoversThePixelsWhoseRaysMeetTheBox) {
  const std::vector<glm::vec3> vertices = tetrahedron(2).vertices;
  Camera beside = odd_camera();  // sees a part of the box only
  beside.name = "beside";
  beside.T.x += 0.4;
  for (const Camera& camera : {odd_camera(), front_camera("front", 40, 30), beside, odd_camera().scaled(301)}) {
    const PixelMask mask = projected_box_mask(camera, vertices);
    ASSERT_EQ(mask.inside.size(), static_cast<std::size_t>(camera.width * camera.height));
    int inside = 0, wrong = 0;
    for (int v = 0; v < camera.height; ++v) {
      for (int u = 0; u < camera.width; ++u) {
        const bool set = mask.inside[static_cast<std::size_t>(v * camera.width + u)] != 0;
        inside += set ? 1 : 0;
        // Corners are rounded to pixels and the fill draws its outline: the edge is right to a pixel and a half.
        bool any = false, all = true;
        for (const glm::dvec2 d :
             {glm::dvec2(0, 0), glm::dvec2(1.5, 0), glm::dvec2(-1.5, 0), glm::dvec2(0, 1.5), glm::dvec2(0, -1.5),
              glm::dvec2(1.1, 1.1), glm::dvec2(-1.1, 1.1), glm::dvec2(1.1, -1.1), glm::dvec2(-1.1, -1.1)}) {
          const bool meets = meets_box(camera, u + d.x, v + d.y, vertices, 0.05);
          any = any || meets;
          all = all && meets;
        }
        wrong += (set && !any) || (!set && all) ? 1 : 0;
      }
    }
    EXPECT_EQ(wrong, 0) << camera.name;
    EXPECT_GT(inside, 20) << camera.name;
  }
}

TEST(BoxMask, HandlesACameraInsideTheBoxAndABodyBehindIt) {
  const std::vector<glm::vec3> vertices = tetrahedron(2).vertices;
  Camera inside = front_camera("inside", 13, 7);
  inside.T = -(inside.R * glm::dvec3(0.1, 1.1, 0.1));
  for (std::uint8_t pixel : projected_box_mask(inside, vertices).inside) EXPECT_EQ(pixel, 1);
  Camera away = inside;
  away.T = -(away.R * glm::dvec3(0.1, 1.1, -5.0));  // looks along −z, the body is at z = 0
  for (std::uint8_t pixel : projected_box_mask(away, vertices).inside) EXPECT_EQ(pixel, 0);
  for (std::uint8_t pixel : projected_box_mask(away, {}).inside) EXPECT_EQ(pixel, 0);
}

}  // namespace
}  // namespace arah
