// All vectors, to the last bit, and the wrapper: node test.mjs (after build.sh).
import { readFile } from "node:fs/promises";
import { FingerError, load } from "./<<p>>.mjs";

const here = new URL(".", import.meta.url);
const { instance } = await WebAssembly.instantiate(await readFile(new URL("vectors.wasm", here)));
let failed = 0;
for (let f = 0; f < <<count>>; ++f) {
  const failures = instance.exports.check_failures(f, 0);
  console.log(`${failures} of ${instance.exports.check_cases(f)} cases of function ${f} failed`);
  failed += failures;
}

const finger = await load(await readFile(new URL("<<p>>.wasm", here)));
const answer = finger.<<first_call>>(<<first_arguments>>);
if (answer.code < 0 || !Object.values(answer.<<first_output>>).flat(Infinity).every(Number.isFinite)) ++failed;
try {
  finger.<<first_call>>(<<bad_arguments>>);
  ++failed;
} catch (error) {
  if (!(error instanceof FingerError)) throw error;
}
console.log(`<<p>> ${finger.version}:`, JSON.stringify(answer));
process.exitCode = failed ? 1 : 0;
