// All vectors, to the last bit, and the wrapper: node test.mjs (after build.sh).
import { readFile } from "node:fs/promises";
import { FingerError, load } from "./<<p>>.mjs";

const here = new URL(".", import.meta.url);
const { instance } = await WebAssembly.instantiate(await readFile(new URL("vectors.wasm", here)));
let failed = 0;
for (let f = 0; f < <<count>>; ++f) {
  const failures = instance.exports.vectors_failures(f);
  console.log(`${failures} of ${instance.exports.check_cases(f)} cases of function ${f} failed`);
  failed += failures;
}

const finger = await load(await readFile(new URL("<<p>>.wasm", here)));
<<use>>
process.exitCode = failed ? 1 : 0;
