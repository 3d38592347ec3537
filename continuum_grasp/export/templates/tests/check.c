/* Runs the vectors; needs memcpy and memcmp, and nothing else. */
#include "check.h"

#include <string.h>

#include "vectors.h"

<<for v, rows, width, outputs, bad in vectors|\n>><<v.runner>><<end>>
static const struct {
  const char *name;
  int (*run)(check_memory *memory, const <<p>>_real *row, <<p>>_real *out, uint32_t abi_bits, int null, int repeat);
  const <<p>>_real *inputs, *outputs;
  const signed char *codes;
  const spoilt_value *bad, *spoilt;
  int rows, input_count, output_count, close, bad_count, pointers, stateful;
} functions[CHECK_FUNCTIONS] = {
<<for v, rows, width, outputs, bad in vectors|,\n>>  {"<<v.name>>", <<v.name>>_run, <<v.name>>_inputs, <<v.name>>_outputs, <<v.name>>_codes, <<v.name>>_bad, <<v.name>>_spoilt,
   <<rows>>, <<width>>, <<outputs>>, <<v.close>>, <<bad>>, <<v.pointers>>, <<v.stateful:d>>}<<end>>
};

/* A row, with the numbers that are not finite. */
static void take_row(int function, int k, <<p>>_real *row)
{
  const spoilt_value *entry;
  const int count = functions[function].input_count;
  memcpy(row, functions[function].inputs + k * count, (size_t)count * sizeof *row);
  for (entry = functions[function].spoilt; entry->row >= 0; ++entry)
    if (entry->row == k) memcpy(&row[entry->entry], &entry->bits, sizeof entry->bits);
}

/* What outputs hold before a call. */
static void mark(<<p>>_real *out, int count)
{
  int k;
  for (k = 0; k < count; ++k) out[k] = (<<p>>_real)(1000 + k);
}

static int left_alone(const <<p>>_real *out, int count)
{
  <<p>>_real marked[<<most_outputs>>];
  mark(marked, count);
  return memcmp(out, marked, (size_t)count * sizeof *out) == 0;
}

/* By the bits of the exponent, as under fast flags a comparison would not tell. */
static int is_finite(const <<p>>_real *number)
{
  uint<<width>>_t bits;
  memcpy(&bits, number, sizeof bits);
  return (bits & <<exponent>>) != <<exponent>>;
}

static int agrees(const <<p>>_real *out, const <<p>>_real *expected, int count, int close, <<p>>_real tolerance)
{
  <<p>>_real greatest = 0;
  int k;
  if (!(tolerance > 0)) return memcmp(out, expected, (size_t)count * sizeof *out) == 0;
  for (k = 0; k < close; ++k) {
    const <<p>>_real size = expected[k] < 0 ? -expected[k] : expected[k];
    if (size > greatest) greatest = size;
  }
  for (k = 0; k < close; ++k) {
    const <<p>>_real off = out[k] < expected[k] ? expected[k] - out[k] : out[k] - expected[k];
    if (!(off <= tolerance * greatest)) return 0;
  }
  return 1;
}

const char *check_name(int function) { return functions[function].name; }

int check_rows(int function) { return functions[function].rows; }

int check_stateful(int function) { return functions[function].stateful; }

int check_kind(int function, int row)
{
  return functions[function].stateful ? (int)functions[function].inputs[row * functions[function].input_count + 3] : 0;
}

int check_run(int function, int row, int repeat, check_memory *memory)
{
  <<p>>_real in[<<most_inputs>>], out[<<most_outputs>>];
  take_row(function, row, in);
  mark(out, functions[function].output_count);
  return functions[function].run(memory, in, out, 0, 0, repeat);
}

int check_cases(int function)
{
  return functions[function].rows + functions[function].bad_count + functions[function].pointers + 1;
}

/* Where rounding may differ, so may warnings of stateful functions: a bound is left by a little more or less. */
static int codes_agree(int function, int code, int expected, <<p>>_real tolerance)
{
  return functions[function].stateful && tolerance > 0 ? (code < 0) == (expected < 0) : code == expected;
}

int check_failures(int function, <<p>>_real tolerance, check_memory *memory)
{
  const int outputs = functions[function].output_count;
  <<p>>_real row[<<most_inputs>>], out[<<most_outputs>>];
  int k, failures = 0;
  if (functions[function].stateful) tolerance *= <<adds_up>>; /* rounding adds up from row to row */
  for (k = 0; k < functions[function].rows; ++k) {
    const <<p>>_real *expected = functions[function].outputs + k * outputs;
    int code;
    take_row(function, k, row);
    mark(out, outputs);
    code = functions[function].run(memory, row, out, 0, 0, 1);
    if (!codes_agree(function, code, functions[function].codes[k], tolerance)) ++failures;
    else if (code < 0 ? !left_alone(out, outputs) : !agrees(out, expected, outputs, functions[function].close, tolerance)) ++failures;
  }
  for (k = 0; k < functions[function].bad_count; ++k) {
    const spoilt_value *bad = &functions[function].bad[k];
    int code;
    take_row(function, bad->row, row);
    memcpy(&row[bad->entry], &bad->bits, sizeof bad->bits);
    mark(out, outputs);
    code = functions[function].run(memory, row, out, 0, 0, 1);
    if (code != bad->code || !left_alone(out, outputs)) ++failures;
  }
  for (k = 0; k <= functions[function].pointers; ++k) { /* null pointers, then another interface */
    const int null = k < functions[function].pointers ? k + 1 : 0, wanted = null ? <<P>>_ERR_NULL : <<P>>_ERR_ABI;
    int code;
    mark(out, outputs);
    take_row(function, 0, row);
    code = functions[function].run(memory, row, out, null ? 0 : 1, null, 1);
    if (code != wanted || !left_alone(out, outputs)) ++failures;
  }
  return failures;
}

static uint32_t next_random(uint32_t *seed) /* xorshift; G. Marsaglia, doi:10.18637/jss.v008.i14 */
{
  *seed ^= *seed << 13;
  *seed ^= *seed >> 17;
  *seed ^= *seed << 5;
  return *seed;
}

int check_fuzz(int function, long rows, uint32_t *seed, check_memory *memory)
{
  const int inputs = functions[function].input_count, outputs = functions[function].output_count;
  <<p>>_real row[<<most_inputs>>], out[<<most_outputs>>];
  long k;
  int j, failures = 0;
  for (k = 0; k < rows; ++k) {
    uint32_t from = next_random(seed) % (uint32_t)functions[function].rows;
    int code;
    take_row(function, (int)from, row);
    from = next_random(seed) % (uint32_t)inputs;
    for (j = 0; j < inputs; ++j) {
      const uint<<width>>_t bits = <<random_bits>>;
      if (k % 4 == 0 || (k % 4 == 1 && next_random(seed) % 4u == 0) || (k % 4 > 1 && from == (uint32_t)j))
        memcpy(&row[j], &bits, sizeof bits);
    }
    mark(out, outputs);
    code = functions[function].run(memory, row, out, 0, 0, 1);
    if (code < 0) {
      failures += !left_alone(out, outputs);
      continue;
    }
    for (j = 0; j < outputs; ++j)
      if (!is_finite(&out[j])) ++failures;
  }
  return failures;
}
