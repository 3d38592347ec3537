const answer = finger.<<name>>(<<given>>);
if (answer.code < 0 || !Object.values(answer.<<output>>).flat(Infinity).every(Number.isFinite)) ++failed;
try {
  finger.<<name>>(<<bad>>);
  ++failed;
} catch (error) {
  if (!(error instanceof FingerError)) throw error;
}
console.log(JSON.stringify(answer));
