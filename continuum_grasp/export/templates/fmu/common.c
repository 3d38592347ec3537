/* <<unit.title>>: <<unit.what>> as an FMU for co-simulation, FMI <<fmi>>. Made by continuum_grasp <<version>>.
   No data of its own that may be written, so that there may be any number of instances, in any threads. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "<<p>>.h"

#define FMU_STEP <<step>> /* s; <<if unit.any_step>>longest internal step<<else>>communication steps are whole multiples of it<<end>> */
#define FMU_TOKEN "<<token>>"

/* Where the groups of real variables begin, which are value references too. */
enum {
<<for name, at in places>>  <<name>> = <<at>>,
<<end>>  FMU_REALS = <<reals>>
};
/* Whole numbers; their value references go on behind those of the real ones, and that of time behind them. */
enum {
<<for name in counts|\n>>  FMU_<<name>>,<<end>>
  FMU_COUNTS
};

enum { FMU_INPUT, FMU_TUNABLE, FMU_START, FMU_RESULT };
typedef struct {
  const char *name, *unit;
  double start, low, high; /* the greatest finite number where any will do */
  int kind, may_be_missing;
} fmu_variable;
static const fmu_variable fmu_variables[FMU_REALS] = {
<<for v in unit.variables|,\n>><<v.c_source>><<end>>
};

typedef enum { FMU_OK, FMU_WARNING, FMU_DISCARD, FMU_ERROR } fmu_level;
typedef enum { FMU_INSTANTIATED = 1, FMU_INITIALIZING = 2, FMU_STEPPING = 4, FMU_TERMINATED = 8 } fmu_mode;

<<types>>

/* Everything that a call may change, without pointers: what is copied where the state of the FMU is asked for. */
typedef struct {
  double time; /* s, as the master counts it, so that it does not drift */
  double values[FMU_REALS];
  int counts[FMU_COUNTS];
  int mode, shown; /* whether results are those of inputs and state */
  fmu_model model;
} fmu_data;

typedef struct {
  fmu_data data, before; /* before: as of the last communication point */
  fmu_scratch scratch;
  int logging;
  void *environment;
  void (*log)(void); /* of the type that the standard gives it */
  char name[1];      /* as long as it is */
} fmu_instance;

static void fmu_send(const fmu_instance *f, fmu_level level, const char *text);

static fmu_level fmu_say(const fmu_instance *f, fmu_level level, const char *format, ...)
{
  char text[512];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  if (f->log && (f->logging || level > FMU_WARNING)) fmu_send(f, level, text);
  return level;
}

/* What a code of the library means: a warning is no more than logged where it is new. */
static fmu_level fmu_judged(fmu_instance *f, const char *call, int code)
{
  fmu_level level = FMU_OK;
  int k;
  if (code < 0) {
    level = fmu_say(f, FMU_DISCARD, "%s: %s", call, <<p>>_strerror(code));
    for (k = 0; k < FMU_REALS; ++k) {
      const fmu_variable *v = &fmu_variables[k];
      const double value = f->data.values[k];
      if (v->kind == FMU_RESULT || (v->may_be_missing && value != value)) continue;
      if (!(value >= v->low && value <= v->high))
        fmu_say(f, FMU_DISCARD, "%s is %.9g, expected %.9g to %.9g [%s]", v->name, value, v->low, v->high, v->unit);
    }
  } else if (code > 0 && code != f->data.counts[FMU_CODE])
    fmu_say(f, FMU_WARNING, "%s: %s", call, <<p>>_strerror(code));
  f->data.counts[FMU_CODE] = code;
  return level;
}

static fmu_level fmu_allowed(const fmu_instance *f, int modes, const char *call)
{
  if (!f) return FMU_ERROR;
  return f->data.mode & modes ? FMU_OK : fmu_say(f, FMU_ERROR, "%s: not allowed now", call);
}

<<glue>>/* ---- what both versions of the standard ask for ---- */

static void fmu_restart(fmu_instance *f)
{
  int k;
  memset(&f->data, 0, sizeof f->data);
  for (k = 0; k < FMU_REALS; ++k) f->data.values[k] = fmu_variables[k].start;
  f->data.mode = FMU_INSTANTIATED;
}

static fmu_instance *fmu_made(const char *name, const char *token)
{
  fmu_instance *f;
  const size_t length = name ? strlen(name) : 0;
  if (!length || !token || strcmp(token, FMU_TOKEN) != 0) return NULL;
  f = (fmu_instance *)calloc(1, sizeof *f + length);
  if (!f) return NULL;
  memcpy(f->name, name, length);
  fmu_restart(f);
  return f;
}

static fmu_level fmu_enter(fmu_instance *f)
{
  const fmu_level level = fmu_allowed(f, FMU_INSTANTIATED, "EnterInitializationMode");
  if (level == FMU_OK) f->data.mode = FMU_INITIALIZING;
  return level;
}

static fmu_level fmu_exit(fmu_instance *f)
{
  fmu_level level = fmu_allowed(f, FMU_INITIALIZING, "ExitInitializationMode");
  if (level != FMU_OK) return level;
  level = fmu_show(f);
  if (level <= FMU_WARNING) f->data.mode = FMU_STEPPING;
  /* There is no way back to before: what cannot begin is an error. */
  return level == FMU_DISCARD ? FMU_ERROR : level;
}

static fmu_level fmu_get(fmu_instance *f, const unsigned *which, size_t n, double *values)
{
  size_t k;
  fmu_level level = fmu_allowed(f, 15, "get");
  if (level != FMU_OK) return level;
  if (n && (!which || !values)) return fmu_say(f, FMU_ERROR, "get: a pointer is null");
  for (k = 0; k < n; ++k) {
    if (which[k] == FMU_REALS + FMU_COUNTS) {
      values[k] = f->data.time;
      continue;
    }
    if (which[k] >= FMU_REALS) return fmu_say(f, FMU_ERROR, "get: no real variable has the value reference %u", which[k]);
    if (fmu_variables[which[k]].kind == FMU_RESULT && !f->data.shown && (level = fmu_show(f)) > FMU_WARNING) return level;
    values[k] = f->data.values[which[k]];
  }
  return FMU_OK;
}

static fmu_level fmu_set(fmu_instance *f, const unsigned *which, size_t n, const double *values)
{
  size_t k;
  const fmu_level level = fmu_allowed(f, FMU_INSTANTIATED | FMU_INITIALIZING | FMU_STEPPING, "set");
  if (level != FMU_OK) return level;
  if (n && (!which || !values)) return fmu_say(f, FMU_ERROR, "set: a pointer is null");
  for (k = 0; k < n; ++k) {
    if (which[k] >= FMU_REALS) return fmu_say(f, FMU_ERROR, "set: no real variable has the value reference %u", which[k]);
    if (fmu_variables[which[k]].kind == FMU_RESULT)
      return fmu_say(f, FMU_ERROR, "set: %s is computed", fmu_variables[which[k]].name);
    if (fmu_variables[which[k]].kind == FMU_START && f->data.mode == FMU_STEPPING)
      return fmu_say(f, FMU_ERROR, "set: %s is given before the simulation alone", fmu_variables[which[k]].name);
  }
  for (k = 0; k < n; ++k) {
    /* The same value again is no change: its bits are compared, since NaN is one. */
    if (memcmp(&f->data.values[which[k]], &values[k], sizeof *values) == 0) continue;
    f->data.values[which[k]] = values[k];
    f->data.shown = 0;
  }
  return FMU_OK;
}

static fmu_level fmu_get_counts(fmu_instance *f, const unsigned *which, size_t n, int *values)
{
  size_t k;
  fmu_level level = fmu_allowed(f, 15, "get");
  if (level != FMU_OK) return level;
  if (n && (!which || !values)) return fmu_say(f, FMU_ERROR, "get: a pointer is null");
  for (k = 0; k < n; ++k) {
    if (which[k] < FMU_REALS || which[k] >= FMU_REALS + FMU_COUNTS)
      return fmu_say(f, FMU_ERROR, "get: no whole number has the value reference %u", which[k]);
    if (!f->data.shown && (level = fmu_show(f)) > FMU_WARNING) return level;
    values[k] = f->data.counts[which[k] - FMU_REALS];
  }
  return FMU_OK;
}

/* Internal steps from a communication point to the next<<if unit.any_step>>, all equally long<<end>>. A step that cannot be done is an error, and
   changes nothing but the code: some masters repeat a discarded step forever. */
static fmu_level fmu_walk(fmu_instance *f, double from, double length)
{
  const double slack = 1e-6 * FMU_STEP, count = length / FMU_STEP;
  double n, h = FMU_STEP, k;
  fmu_level level = fmu_allowed(f, FMU_STEPPING, "DoStep");
  if (level != FMU_OK) return level;
  if (!(fabs(from - f->data.time) <= slack + 1e-12 * fabs(from)))
    return fmu_say(f, FMU_ERROR, "DoStep: from %.12g s, but this FMU is at %.12g s", from, f->data.time);
  if (!(count > 0 && count < 1e9))
    return fmu_say(f, FMU_ERROR, "DoStep: expected a communication step size above zero, got %.9g s", length);
  n = (double)(long)(count + 0.5);
  if (n < 1 || fabs(length - n * FMU_STEP) > slack + 1e-12 * fabs(from + length)) {<<if unit.any_step>>
    n = ceil(count);
    h = length / n;<<else>>
    return fmu_say(f, FMU_ERROR, "DoStep: expected a communication step size that is a whole multiple of %.9g s, got %.9g s",
                   FMU_STEP, length);<<end>>
  }
  f->before = f->data;
  for (k = 0; k < n; ++k)
    if ((level = fmu_advance(f, h)) > FMU_WARNING) {
      const int code = f->data.counts[FMU_CODE];
      f->data = f->before;
      f->data.counts[FMU_CODE] = code;
      return fmu_say(f, FMU_ERROR, "DoStep: no step from %.12g s to %.12g s, nothing has changed", from, from + length);
    }
  f->data.time = from + length;
  return FMU_OK;
}

static fmu_data *fmu_copied(const fmu_data *from)
{
  fmu_data *to = (fmu_data *)malloc(sizeof *to);
  if (to) memcpy(to, from, sizeof *to);
  return to;
}

/* As bytes: the token, by which those of another FMU are noticed, the data, and a checksum of both. */
#define FMU_BYTES (sizeof FMU_TOKEN + sizeof(fmu_data) + FMU_SUM)
enum { FMU_SUM = 8 };

/* The 64 bits of FNV-1a (G. Fowler, L. C. Noll, K.-P. Vo), byte by byte: each byte is a permutation of the sum, so that
   no single byte changes unnoticed. */
static void fmu_summed(const char *bytes, size_t size, unsigned char *to)
{
  unsigned long long sum = 14695981039346656037ULL;
  size_t k;
  for (k = 0; k < size; ++k) sum = (sum ^ (unsigned char)bytes[k]) * 1099511628211ULL;
  for (k = 0; k < FMU_SUM; ++k) to[k] = (unsigned char)(sum >> 8 * k & 255);
}

static fmu_level fmu_packed(const fmu_instance *f, const fmu_data *state, char *bytes, size_t size)
{
  if (!f || !state || !bytes) return FMU_ERROR;
  if (size < FMU_BYTES) return fmu_say(f, FMU_ERROR, "a serialized state takes %lu bytes, not %lu", (unsigned long)FMU_BYTES, (unsigned long)size);
  memcpy(bytes, FMU_TOKEN, sizeof FMU_TOKEN);
  memcpy(bytes + sizeof FMU_TOKEN, state, sizeof *state);
  fmu_summed(bytes, FMU_BYTES - FMU_SUM, (unsigned char *)bytes + FMU_BYTES - FMU_SUM);
  return FMU_OK;
}

static fmu_level fmu_unpacked(const fmu_instance *f, const char *bytes, size_t size, fmu_data **state)
{
  fmu_data *made;
  unsigned char sum[FMU_SUM];
  if (!f || !bytes || !state) return FMU_ERROR;
  if (size != FMU_BYTES || memcmp(bytes, FMU_TOKEN, sizeof FMU_TOKEN) != 0)
    return fmu_say(f, FMU_ERROR, "this is no serialized state of this FMU");
  fmu_summed(bytes, FMU_BYTES - FMU_SUM, sum);
  if (memcmp(bytes + FMU_BYTES - FMU_SUM, sum, FMU_SUM) != 0)
    return fmu_say(f, FMU_ERROR, "the serialized state was damaged: its checksum differs");
  made = (fmu_data *)malloc(sizeof *made);
  if (!made) return fmu_say(f, FMU_ERROR, "no memory");
  memcpy(made, bytes + sizeof FMU_TOKEN, sizeof *made);
  free(*state);
  *state = made;
  return FMU_OK;
}
