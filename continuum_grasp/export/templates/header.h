/* <<title>>
 *
 * C99 of <<what>>, made by continuum_grasp <<version>>. No heap, no mathematical library, no writable
 * data of its own: any function may be called from any thread or interrupt, with data that the caller owns.
 *
<<if calls>> *   <<p>>_model model;
 *   <<p>>_init(&model);                     once; then change model.parameters, where there are any, as you like
 *   code = <<p>>_...(&model, ..., &output);
<<else>> *   static <<p>>_<<owner>> <<owner>>;
 *   static <<p>>_<<owner>>_work work;
 *   <<p>>_<<owner>>_init(&<<owner>>);             once
 *   code = <<p>>_<<step>>(&<<owner>>, &work, ...);      every period
<<end>> *
 * SI units, angles in radians, world axes. A struct is its numbers in their order, without padding, so that it may be
 * copied from and to an array. A function returns a code of the table below: zero or above, the output is written;
 * below zero, it was left alone. No input is clamped. Outputs may be the inputs themselves.
 */
#ifndef <<P>>_H
#define <<P>>_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What functions and tables are marked with: where the source is compiled as CUDA, they are for the device. */
#ifdef __CUDACC__
#define <<P>>_API __device__
#else
#define <<P>>_API
#endif

#define <<P>>_VERSION "<<version>>"
#define <<P>>_ABI <<abi>>                 /* of all in this header; another one where any of it differs */
#define <<P>>_CONFIGURATION "<<hash>>" /* of all that is compiled: equations, constants, nominal values, ranges, sub-steps */

typedef <<real>> <<p>>_real;

<<for name, value in constants|\n>>#define <<P>>_<<name>> <<value>><<end>>

/* What the functions return. */
typedef enum {
<<for name, code, comma in codes|\n>>  <<P>>_<<name>> = <<code.value:2d>><<comma>> /* <<code.text>> */<<end>>
} <<p>>_code;

<<structs>>
<<if calls>>/* The finger, as every function takes it. */
typedef struct {
  uint32_t abi; /* set by <<p>>_init, read by every function */<<if subject.parameters>>
  <<p>>_parameters parameters;<<end>>
} <<p>>_model;

/* Make a model ready, with the parameters that it was made from. */
#define <<p>>_init(model) <<p>>_init_abi((model), <<P>>_ABI)
<<P>>_API int <<p>>_init_abi(<<p>>_model *model, uint32_t abi);

<<end>><<functions>>
/* What a code means, as a sentence. */
<<P>>_API const char *<<p>>_strerror(int code);
/* Version and interface that the library was compiled from, and the hash of what it computes. */
<<P>>_API const char *<<p>>_version(void);
<<P>>_API uint32_t <<p>>_abi(void);
<<P>>_API const char *<<p>>_configuration(void);
/* Whether the library is the one that the caller was compiled for, to be asked once: zero, <<P>>_ERR_ABI where structs or
   functions differ, <<P>>_ERR_CONFIGURATION where it computes something else. */
#define <<p>>_check() <<p>>_check_built(<<P>>_ABI, <<P>>_CONFIGURATION)
<<P>>_API int <<p>>_check_built(uint32_t abi, const char *configuration);

#ifdef __cplusplus
}
#endif

#endif
