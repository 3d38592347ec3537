/* Codes of the plant, as those of exported packages. */
#include "<<p>>_plant.h"

enum { <<for c in codes|, >><<P>>_<<c.name>> = <<c.value>><<end>> };

static const char *<<p>>_strerror(int code)
{
  switch (code) {
<<for c in codes>>    case <<P>>_<<c.name>>: return "<<c.text>>";
<<end>>    default: return "no code of this library";
  }
}
