// What programs tell the sanitizers (preset asan): part of each test program, and of those that tests run, where ARAH_SANITIZE is set.

// What is freed stays poisoned for a while; 256 MB of it, the default, would break the bounds on memory that tests hold on to.
extern "C" const char* __asan_default_options() { return "quarantine_size_mb=16"; }
extern "C" const char* __ubsan_default_options() { return "print_stacktrace=1"; }

// Not ours. The validation layer of Debian 12 (1.3.239) leaves some 90 KB behind where devices were made and destroyed, Open MPI 4.1.4 some 10 KB
// after its end: its libraries, its plugins, and texts that they had the C library format.
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libVkLayer_khronos_validation.so\n"
         "leak:libmpi.so\nleak:libopen-pal.so\nleak:libopen-rte.so\nleak:libpmix.so\nleak:/openmpi3/\nleak:libhwloc.so\nleak:__vasprintf_internal\n";
}
// Nor told of at each end, in words that tests would take for the layer's own.
extern "C" const char* __lsan_default_options() { return "print_suppressions=0"; }

// Leaks are told apart by the library that made them, so the Vulkan loader must not unload it before they are counted.
extern "C" int dlclose(void*) noexcept { return 0; }
