// What refusing a hostile file costs.
#pragma once

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdint>
#include <functional>

#include "host/input_error.h"

namespace arah {

// Bytes. The address sanitizer keeps a byte of shadow for every eight, 16 bytes or more around every block, and for a while what
// was freed (tests/sanitizers.cpp): half as much again.
#if defined(__SANITIZE_ADDRESS__)
inline constexpr std::uint64_t kMostMemoryOfRefusal = 768'000'000;
#else
inline constexpr std::uint64_t kMostMemoryOfRefusal = 512'000'000;
#endif

// Peak memory of `action` in a process of its own, bytes. The action must throw an InputError. The process begins with the
// test's own memory, so make large files in a scope of their own.
inline std::uint64_t memory_of_refusal(const std::function<void()>& action) {
  const pid_t child = ::fork();
  if (child == 0) {
    int code = 1;
    try {
      action();
    } catch (const InputError&) {
      code = 0;
    } catch (...) {
    }
    ::_exit(code);
  }
  int status = 0;
  rusage usage{};
  ::wait4(child, &status, 0, &usage);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << "no InputError; status " << status;
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

}  // namespace arah
