/* What the fields of all structs are, readable at run time. Made by continuum_grasp <<version>>. */
#include "<<p>>.h"

<<P>>_API static const struct {
  char of[<<of>>], name[<<name>>], unit[<<unit>>];
  uint32_t size;
  <<p>>_real low, high;
} fields[] = {
<<for of, f, low, high in rows|,\n>>  {"<<of>>", "<<f.name>>", "<<f.unit>>", <<f.size>>, <<low>>, <<high>>}<<end>>
};

<<P>>_API uint32_t <<p>>_fields(void) { return <<count>>; }

<<P>>_API const char *<<p>>_field_struct(uint32_t field) { return field < <<count>> ? fields[field].of : 0; }

<<P>>_API const char *<<p>>_field_name(uint32_t field) { return field < <<count>> ? fields[field].name : 0; }

<<P>>_API const char *<<p>>_field_unit(uint32_t field) { return field < <<count>> ? fields[field].unit : 0; }

<<P>>_API uint32_t <<p>>_field_size(uint32_t field) { return field < <<count>> ? fields[field].size : 0; }

<<P>>_API <<p>>_real <<p>>_field_low(uint32_t field) { return field < <<count>> ? fields[field].low : 0; }

<<P>>_API <<p>>_real <<p>>_field_high(uint32_t field) { return field < <<count>> ? fields[field].high : 0; }
