// How much work a queue holds, kept on the device: the first three words are an indirect launch's group counts.
#ifndef ARAH_SHARED_WORK_COUNT_H
#define ARAH_SHARED_WORK_COUNT_H
#ifdef __cplusplus
#include <cstdint>
namespace arah {
using uint = uint32_t;
#endif

struct WorkCount {
  uint groups_x;  // ceil(count / 64)
  uint groups_y;  // 1
  uint groups_z;  // 1
  uint count;
};

#ifdef __cplusplus
static_assert(sizeof(WorkCount) == 16);
}  // namespace arah
#endif
#endif
