#if !defined(FMI<<v>>_Export)
#if defined _WIN32 || defined __CYGWIN__
#define FMI<<v>>_Export __declspec(dllexport)
#elif defined __GNUC__
#define FMI<<v>>_Export __attribute__((visibility("default")))
#else
#define FMI<<v>>_Export
#endif
#endif
/* Where sources of several FMUs are linked together, each has its own names; a build may define it as nothing. */
#ifndef FMI<<v>>_FUNCTION_PREFIX
#define FMI<<v>>_FUNCTION_PREFIX
#endif
#define FMI<<v>>_JOINED(a, b) a##b
#define FMI<<v>>_NAMED(a, b) FMI<<v>>_JOINED(a, b)
#define FMI<<v>>_NAME(name) FMI<<v>>_NAMED(FMI<<v>>_FUNCTION_PREFIX, name)
#define FMI<<v>>(type, name) FMI<<v>>_Export type FMI<<v>>_NAME(name)

