/* The numbers between the commas of a line. */
static void line_read(const char *text, <<p>>_measurement *measurement)
{
  <<p>>_real numbers[MEASURED];
  int k;
  for (k = 0; k < MEASURED; ++k) {
    char *end;
    const double number = strtod(text, &end);
    numbers[k] = (<<p>>_real)(end == text ? strtod("nan", NULL) : number);
    text += strcspn(text, ",");
    if (*text == ',') ++text;
  }
  memcpy(measurement, numbers, sizeof *measurement);
}

