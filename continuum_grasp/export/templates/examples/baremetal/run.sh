#!/bin/sh
# Builds the vectors for an emulated board and runs them there: run.sh cortex-m4f|cortex-m7 [flags for the compiler]
# Needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$here/../..
core=${1:-<<core>>}
[ $# -eq 0 ] || shift
case $core in
  cortex-m4f) cpu="-mcpu=cortex-m4 -mfpu=fpv4-sp-d16" board="mps2-an386 -cpu cortex-m4" ;;
  cortex-m7) cpu="-mcpu=cortex-m7 -mfpu=fpv5-d16" board="mps2-an500 -cpu cortex-m7" ;;
  *) echo "run.sh: cortex-m4f or cortex-m7, not $core" >&2; exit 2 ;;
esac
build=${BUILD:-$here/build-$core}
mkdir -p "$build"
arm="arm-none-eabi-gcc $cpu -mthumb -mfloat-abi=hard -ffunction-sections -fdata-sections -fno-common"
# Before registers are allocated, gcc moves loads of long straight-line code so far ahead that it stores most of it again.
strict="-std=c99 -O2 -fno-schedule-insns -ffp-contract=off -fno-math-errno -fstack-usage"
for source in <<sources>>; do
  case $source in # short loops of the controller, over states and inputs, are written out
    *_control) short="-fpeel-loops --param=max-completely-peel-times=6" ;;
    *) short= ;;
  esac
  $arm $strict $short "$@" -I"$root/include" -c "$root/src/$source.c" -o "$build/$source.o"
done
for source in "$root/tests/check.c" "$here/start.c" "$here/main.c"; do
  $arm -std=gnu99 -O1 -I"$root/include" -I"$root/tests" -I"$here" -c "$source" -o "$build/$(basename "$source" .c)_.o"
done
$arm -nostartfiles -T "$here/board.ld" -Wl,--gc-sections "$build"/*.o -specs=nosys.specs -o "$build/image.elf"
(cd "$build" && for source in <<sources>>; do arm-none-eabi-size "$source.o"; done)
qemu-system-arm -M $board -nographic -monitor none -serial none -semihosting-config enable=on,target=native \
  -icount shift=0 -kernel "$build/image.elf"
