#!/bin/sh
# Compiles the library to WebAssembly with clang and lld alone: build.sh [FOLDER], then "node FOLDER/test.mjs". With
# "build.sh FOLDER library" the test's program is left out.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$here/..
out=${1:-$here}
clang=${CLANG:-clang}
mkdir -p "$out"
sources=
for source in <<sources>>; do sources="$sources $root/src/$source.c"; done
flags="--target=wasm32 -nostdlib -std=c99 -O2 -ffp-contract=off -fno-builtin -mbulk-memory -Wl,--no-entry -Wl,--strip-all
  -Wl,--export=__heap_base"
$clang $flags <<for name in exports| >>-Wl,--export=<<name>><<end>> -I"$here" -I"$root/include" \
  $sources "$here/string.c" -o "$out/<<p>>.wasm"
[ "${2:-}" = library ] && exit
$clang $flags -Wl,--export=vectors_failures -Wl,--export=check_cases -I"$here" -I"$root/include" -I"$root/tests" \
  $sources "$root/tests/check.c" "$here/vectors.c" "$here/string.c" -o "$out/vectors.wasm"
[ "$out" -ef "$here" ] || cp "$here"/*.mjs "$out"
