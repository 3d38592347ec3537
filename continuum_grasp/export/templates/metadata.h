/* Fields of all structs of this header, struct by struct in their order, numbered from zero: how many there are, and of
   each its struct, name and unit, how many numbers it has, and the range of these (the greatest finite number where any
   will do). Beyond the last one: null, zero. */
<<P>>_API uint32_t <<p>>_fields(void);
<<P>>_API const char *<<p>>_field_struct(uint32_t field);
<<P>>_API const char *<<p>>_field_name(uint32_t field);
<<P>>_API const char *<<p>>_field_unit(uint32_t field);
<<P>>_API uint32_t <<p>>_field_size(uint32_t field);
<<P>>_API <<p>>_real <<p>>_field_low(uint32_t field);
<<P>>_API <<p>>_real <<p>>_field_high(uint32_t field);
