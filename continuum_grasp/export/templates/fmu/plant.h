/* Codes of the plant, as those of exported packages. */
#include "<<p>>_plant.h"

enum { <<codes>> };

static const char *<<p>>_strerror(int code)
{
  switch (code) {
<<texts>>    default: return "no code of this library";
  }
}
