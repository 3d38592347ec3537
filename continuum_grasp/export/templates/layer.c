/* The public functions: every number that comes in is checked before, every number that goes out after the kernels.
   Made by continuum_grasp <<version>>. */
#include "<<p>>_internal.h"

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

/* Structs are their numbers (an array of negative size is an error). */
<<for struct in contents.structs|\n>>typedef char <<p>>_<<struct.name>>_has_no_padding[sizeof(<<p>>_<<struct.name>>) == <<struct.size>> * sizeof(<<p>>_real) ? 1 : -1];<<end>>

<<if calls>>/* Ranges; the greatest finite number where any will do. */
<<bounds>>

<<structs>><<check>>
<<P>>_API static int all_finite(const <<p>>_real *numbers, int count)
{
  int k;
  for (k = 0; k < count; ++k)
    if (!<<p>>_is_finite(&numbers[k])) return 0;
  return 1;
}

<<P>>_API int <<p>>_init_abi(<<p>>_model *model, uint32_t abi)
{
  if (!model) return <<P>>_ERR_NULL;
  if (abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  model->abi = abi;<<for name, value in nominal>>
  model->parameters.<<name>> = <<value>>;<<end>>
  return <<P>>_OK;
}

<<functions>>
<<end>><<P>>_API const char *<<p>>_strerror(int code)
{
  switch (code) {
<<for code in contents.codes|\n>>    case <<P>>_<<code.name>>: return "<<code.text>>";<<end>>
    default: return "no code of this library";
  }
}

<<P>>_API const char *<<p>>_version(void) { return <<P>>_VERSION; }

<<P>>_API uint32_t <<p>>_abi(void) { return <<P>>_ABI; }

<<P>>_API const char *<<p>>_configuration(void) { return <<P>>_CONFIGURATION; }

<<P>>_API int <<p>>_check_built(uint32_t abi, const char *configuration)
{
  const char *own = <<P>>_CONFIGURATION;
  if (!configuration) return <<P>>_ERR_NULL;
  if (abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  while (*own && *own == *configuration) ++own, ++configuration;
  return *own == *configuration ? <<P>>_OK : <<P>>_ERR_CONFIGURATION;
}
