// Independent pieces of work on all cores of the machine.
#pragma once

#include <cstddef>
#include <functional>

namespace arah {

// Runs job(0) … job(count − 1), in no order. The first error stops the others and is thrown here.
void run_jobs(std::size_t count, const std::function<void(std::size_t)>& job);

}  // namespace arah
