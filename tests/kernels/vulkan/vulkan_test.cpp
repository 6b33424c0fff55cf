// The Vulkan layer itself: what a launch refuses, what the SPIR-V says of it, and that memory comes back as it was sent.
#include <gmock/gmock.h>

#include <cstring>
#include <optional>

#include "shaders/embedded.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

using testing::HasSubstr;

class Vulkan : public DeviceTest {
 protected:
  struct Sizes {
    uint32_t texels, splits, split_stride;
  };

  // reduction of linear/reduce_partials over 2 splits of 64 texels
  Launch launch(Buffer& partials, Buffer& total) {
    sizes_ = {64, 2, 64};
    Launch launch;
    launch.pipeline = &device.pipeline("linear/reduce_partials", {0});
    launch.name = "two splits";
    launch.bindings = {{partials.slice(), 2 * 64 * 16}, {total.slice(), 64 * 16}};
    launch.push_constants = &sizes_;
    launch.push_constant_bytes = sizeof sizes_;
    return launch;
  }
  std::string refusal(const Launch& launch) {
    try {
      commands.dispatch(launch);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  }

 private:
  Sizes sizes_{};
};

TEST_F(Vulkan, ALaunchAddsUpWhatWasUploaded) {
  const std::vector<float> values = uniform(2 * 64 * 4);
  Buffer partials = filled("partials", values), total = empty("total", 64 * 16);
  commands.dispatch(launch(partials, total));
  commands.submit_and_wait();
  const std::vector<float> sums = device.download<float>(total.slice().elements(0, 256));
  for (size_t i = 0; i < 256; ++i) ASSERT_EQ(sums[i], values[i] + values[256 + i]) << i;
}

TEST_F(Vulkan, ALaunchThatDoesNotFitIsRefusedWithBothValues) {
  Buffer partials = empty("partials", 2 * 64 * 16), total = empty("total", 64 * 16);
  Launch one_short = launch(partials, total);
  one_short.bindings.pop_back();
  EXPECT_THAT(refusal(one_short), AllOf(HasSubstr("two splits"), HasSubstr("takes 2 bindings, 1 given")));
  Launch small = launch(partials, total);
  small.bindings[0] = {partials.slice().sub(0, 256), 2 * 64 * 16};
  EXPECT_THAT(refusal(small), AllOf(HasSubstr("needs 2048 bytes"), HasSubstr("'partials' gives 256")));
  Launch empty_slice = launch(partials, total);
  empty_slice.bindings[1] = BufferSlice{};
  EXPECT_THAT(refusal(empty_slice), HasSubstr("is empty"));
  Launch crooked = launch(partials, total);
  crooked.bindings[1] = total.slice().sub(4, 64);
  EXPECT_THAT(refusal(crooked), HasSubstr("no multiple of"));
  Launch constants = launch(partials, total);
  constants.push_constant_bytes = 8;
  EXPECT_THAT(refusal(constants), HasSubstr("takes 12 bytes of push constants, 8 given"));
  Launch wide = launch(partials, total);
  wide.groups = {device.report().max_workgroups_x + 1, 1, 1};
  EXPECT_THAT(refusal(wide), HasSubstr("workgroups in one dimension"));
  Launch nothing = launch(partials, total);
  nothing.pipeline = nullptr;
  EXPECT_THAT(refusal(nothing), HasSubstr("has no pipeline"));
}

TEST_F(Vulkan, TheInterfaceIsReadFromTheSpirv) {
  const ShaderInterface& face = device.pipeline("linear/reduce_partials", {0}).interface;
  ASSERT_EQ(face.bindings.size(), 2u);
  EXPECT_EQ(face.bindings[0].type, BindingType::storage_texel_buffer);
  EXPECT_EQ(face.bindings[1].type, BindingType::storage_buffer);
  EXPECT_EQ(face.push_constant_bytes, 12u);
  EXPECT_EQ(face.local_size, (std::array<uint32_t, 3>{64, 1, 1}));
  const ShaderInterface& both = device.pipeline("linear/tiled_forward", {8, 8}).interface;
  ASSERT_EQ(both.bindings.size(), 8u);
  EXPECT_FALSE(both.bindings[0].words) << "four floats in a texel";
  EXPECT_EQ(both.bindings[7].type, BindingType::storage_texel_buffer);
  EXPECT_TRUE(both.bindings[7].words) << "four words";
}

TEST_F(Vulkan, EveryEmbeddedShaderHasAnInterfaceAndCutOnesAreRefused) {
  for (const EmbeddedShader* shader = embedded_shaders(); shader->name; ++shader) {
    std::vector<uint32_t> words(static_cast<size_t>(shader->end - shader->begin) / 4);
    std::memcpy(words.data(), shader->begin, words.size() * 4);
    EXPECT_FALSE(reflect_spirv(words.data(), words.size()).bindings.empty()) << shader->name;
    // five words of header, then OpCapability with two: six words end inside it
    EXPECT_THROW(reflect_spirv(words.data(), 6), std::runtime_error) << shader->name;
  }
  const std::vector<uint32_t> noise(16, 0x12345678);
  EXPECT_THROW(reflect_spirv(noise.data(), noise.size()), std::runtime_error);
  EXPECT_THROW(reflect_spirv(noise.data(), 2), std::runtime_error);
}

TEST_F(Vulkan, SlicesStayInsideTheirBuffer) {
  Buffer buffer = empty("a buffer", 1024);
  EXPECT_EQ(buffer.slice().sub(256, 768).bytes, 768u);
  EXPECT_THROW(buffer.slice().sub(256, 769), std::out_of_range);
  EXPECT_THROW(buffer.slice().sub(1025, 0), std::out_of_range);
  EXPECT_THROW(buffer.slice().elements(1, ~0ull / 4), std::out_of_range);
  EXPECT_THROW(device.upload(buffer.slice().sub(0, 4), std::vector<float>(2)), std::out_of_range);
  EXPECT_THROW(Buffer(device, "nothing", 0, BufferPlace::device), std::invalid_argument);
}

TEST_F(Vulkan, AnAllocationThatIsTooLargeNamesTheBuffer) {
  const uint64_t before = device.allocated_bytes();
  try {
    Buffer huge(device, "huge", device.report().max_allocation_bytes + 256, BufferPlace::device);
    FAIL() << "accepted";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("'huge'"));
  }
  EXPECT_EQ(device.allocated_bytes(), before);
}

TEST_F(Vulkan, NoMoreIsBoundAtOnceThanTheDeviceAllows) {
  const uint64_t most = device.report().max_storage_buffer_bytes;
  if (most >= device.report().max_allocation_bytes) GTEST_SKIP() << "no buffer is larger than what this device binds";
  Buffer partials = empty("a large buffer", most + 256), total = empty("total", 64 * 16);
  EXPECT_THAT(refusal(launch(partials, total)), AllOf(HasSubstr("'a large buffer'"), HasSubstr(std::to_string(most))));
  Launch piece = launch(partials, total);
  piece.bindings[0] = {partials.slice().sub(256, 2 * 64 * 16), 2 * 64 * 16};
  EXPECT_EQ(refusal(piece), "accepted");
}

TEST_F(Vulkan, AMemoryCeilingIsKeptAndSaysWhoHoldsWhat) {
  DeviceOptions options = DeviceOptions::from_environment();
  options.memory_ceiling = 4 << 20;
  Device small(options);
  std::optional<Buffer> rays;
  rays.emplace(small, "rays: colours", 3 << 20, BufferPlace::device);
  try {
    Buffer(small, "moments", 2 << 20, BufferPlace::device);
    ADD_FAILURE() << "5 MiB under a ceiling of 4";
  } catch (const MemoryCeilingError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("'moments'"), HasSubstr("asks for 2.0M"), HasSubstr("ceiling is 4.0M"), HasSubstr("3.0M are held: 3.0M rays"),
                                    HasSubstr("A ceiling of 5M")));
  }
  EXPECT_EQ(small.allocated_bytes(), 3u << 20);
  rays.reset();
  const Buffer moments(small, "moments", 4 << 20, BufferPlace::device);
  EXPECT_EQ(small.most_allocated_bytes(), 4u << 20);
}

TEST_F(Vulkan, APlanCountsBuffersAndMakesNone) {
  const uint64_t before = device.allocated_bytes();
  const uint64_t bytes = device.bytes_of([&] {
    Buffer partials(device, "partials", 1ull << 30, BufferPlace::device), total = empty("total", 64 * 16);
    device.upload(partials.slice(), std::vector<float>(64, 1.0f));
    commands.fill(total.slice(), 7);
    commands.dispatch(launch(partials, total));
    commands.submit_and_wait();
    for (const uint32_t word : device.download<uint32_t>(total.slice())) EXPECT_EQ(word, 0u);
    EXPECT_EQ(device.allocated_bytes(), before);
  });
  EXPECT_EQ(bytes, (1ull << 30) + 64 * 16);
  EXPECT_EQ(device.bytes_of([] {}), 0u);
}

TEST_F(Vulkan, CompilingIsReportedWhileItLasts) {
  std::vector<ShaderProgress> reports;
  DeviceOptions options = DeviceOptions::from_environment();
  options.compiling = [&](const ShaderProgress& progress) { reports.push_back(progress); };
  Device watched(options);
  Commands own(watched);
  Buffer partials(watched, "partials", 2 * 64 * 16, BufferPlace::device), total(watched, "total", 64 * 16, BufferPlace::device);
  Launch some = launch(partials, total);
  some.pipeline = &watched.pipeline("linear/reduce_partials", {0});
  for (int i = 0; i < 2; ++i) own.dispatch(some);
  own.submit_and_wait();
  own.dispatch(some);
  own.submit_and_wait();
  // Before and after its first launch alone.
  ASSERT_EQ(reports.size(), 2u);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(reports[i].shader, "linear/reduce_partials");
    EXPECT_EQ(reports[i].done, i == 1);
    EXPECT_EQ(reports[i].pipelines, 1u);
  }
  EXPECT_EQ(reports[0].seconds, 0);
  EXPECT_GT(watched.pipeline_seconds(), 0);
  EXPECT_EQ(watched.pipeline_seconds(), reports[1].seconds);
}

TEST_F(Vulkan, FillAndCopyAreSeenByWhatFollows) {
  Buffer a = empty("a", 1024), b = empty("b", 1024);
  commands.fill(a.slice(), 7);
  commands.copy(a.slice().sub(0, 512), b.slice().sub(512, 512));
  commands.fill(b.slice().sub(0, 512), 9);
  commands.submit_and_wait();
  const auto words = device.download<uint32_t>(b.slice());
  EXPECT_EQ(words[0], 9u);
  EXPECT_EQ(words[127], 9u);
  EXPECT_EQ(words[128], 7u);
  EXPECT_THROW(commands.copy(a.slice(), b.slice().sub(0, 4)), std::invalid_argument);
}

TEST_F(Vulkan, TheHostMayWorkWhileCommandsRun) {
  const std::vector<uint32_t> numbers{7, 8, 9, 10};
  Buffer source(device, "from", 16, BufferPlace::device), target(device, "to", 16, BufferPlace::device);
  const BufferSlice from = source.slice().elements(0, 4), to = target.slice().elements(0, 4);
  device.upload(from, numbers);
  commands.wait();  // nothing runs
  commands.copy(from, to);
  commands.submit();
  EXPECT_THROW(commands.fill(from, 0), std::logic_error);
  commands.wait();
  EXPECT_EQ(device.download<uint32_t>(to), numbers);
  commands.fill(to, 5);
  commands.submit_and_wait();
  EXPECT_EQ(device.download<uint32_t>(to), std::vector<uint32_t>(4, 5));
}

TEST_F(Vulkan, AMovedBufferKeepsItsMemoryAndItsPlaceInTheLedger) {
  const uint64_t before = device.allocated_bytes();
  {
    Buffer first = filled("first", std::vector<float>{1, 2, 3});
    Buffer second = std::move(first);
    EXPECT_EQ(device.download<float>(second.slice().elements(0, 3)), (std::vector<float>{1, 2, 3}));
    EXPECT_THAT(device.memory_table(), HasSubstr("first"));
  }
  EXPECT_EQ(device.allocated_bytes(), before);
}

TEST_F(Vulkan, UnknownShadersAndDevicesAreNamed) {
  EXPECT_THROW(device.pipeline("linear/no_such_shader"), std::invalid_argument);
  DeviceOptions options;
  options.wanted = "no such device";
  try {
    Device other(options);
    FAIL() << "opened";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("no usable Vulkan device"), HasSubstr("not the wanted 'no such device'")));
  }
  const std::vector<DeviceReport> reports = survey_devices();
  ASSERT_FALSE(reports.empty());
  for (const DeviceReport& report : reports) EXPECT_EQ(report.usable(), report.refusals.empty());
}

TEST_F(Vulkan, LaunchesAreCountedAndTimedByName) {
  DeviceOptions options = DeviceOptions::from_environment();
  options.profile = true;
  Device timed(options);
  if (timed.report().timestamp_period_ns <= 0) GTEST_SKIP() << "this device has no timestamps";
  Commands own(timed);
  Buffer a(timed, "partials", 2048, BufferPlace::device), b(timed, "total", 1024, BufferPlace::device);
  const struct {
    uint32_t texels, splits, split_stride;
  } sizes{64, 2, 64};
  for (int i = 0; i < 3; ++i) {
    Launch launch;
    launch.pipeline = &timed.pipeline("linear/reduce_partials", {0});
    launch.name = "three times";
    launch.bindings = {a.slice(), b.slice()};
    launch.push_constants = &sizes;
    launch.push_constant_bytes = sizeof sizes;
    launch.cost = {100, 200};
    own.dispatch(launch);
  }
  own.submit_and_wait();
  // A launch over a quarter of the rows that there is room for does a quarter of the work.
  Buffer count(timed, "count", 12, BufferPlace::shared);
  timed.upload(count.slice(), std::vector<uint32_t>{1, 1, 1});
  own.stage("the quarter");
  Launch launch;
  launch.pipeline = &timed.pipeline("linear/reduce_partials", {0});
  launch.name = "one of four groups";
  launch.bindings = {a.slice(), b.slice()};
  launch.push_constants = &sizes;
  launch.push_constant_bytes = sizeof sizes;
  launch.indirect = launch.cost_count = count.slice();
  launch.cost_groups = 4;
  launch.cost = {100, 200};
  own.dispatch(launch);
  own.submit_and_wait();
  EXPECT_EQ(timed.profiler().launches().at("one of four groups").cost.flops, 25);
  EXPECT_EQ(timed.profiler().stages().at("the quarter").cost.bytes, 50);
  EXPECT_EQ(timed.profiler().shaders().at("linear/reduce_partials").calls, 4u);
  EXPECT_EQ(timed.profiler().stages().at("").calls, 3u);

  const LaunchStatistics& statistics = timed.profiler().launches().at("three times");
  EXPECT_EQ(statistics.calls, 3u);
  EXPECT_GT(statistics.milliseconds, 0);
  EXPECT_EQ(statistics.cost.flops, 300);
  EXPECT_THAT(timed.profiler().table(), HasSubstr("three times"));
}

}  // namespace
}  // namespace arah
