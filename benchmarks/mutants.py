"""What the quick tests notice: one-line faults, each tried with the tests that mirror its module.

python -m benchmarks.mutants                 # all faults, against tests/ of their module (40 min on two cores)
python -m benchmarks.mutants --only grasp    # those whose file name contains a text
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from queue import SimpleQueue

from benchmarks.harness import ROOT
from benchmarks.report import begun

PATIENCE = 600.0
"""Wall time after which the tests of a fault are stopped [s]; a program that no longer ends is noticed by anyone."""
CAUGHT = 0.95
"""Share of faults that the quick tests have to notice."""


@dataclass(frozen=True)
class Fault:
    """A fault: what stands in a file just once, and what is put in its place."""

    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]
    reason: str = ""
    """Why the program is as good with it, where no test can notice it."""

    @property
    def name(self) -> str:
        """File and what is put there."""
        return f"{self.file}: {self.right} -> {self.wrong}"

    def put_into(self, text: str) -> str:
        """Put the fault into the text of its file; a fault that fits nowhere, or twice, is an error."""
        if text.count(self.right) != 1:
            raise ValueError(f"{self.name}: stands {text.count(self.right)} times in the file, expected once")
        return text.replace(self.right, self.wrong)


def _read() -> tuple[Fault, ...]:
    """The faults, in their order; ``faults.txt`` says how they are written."""
    found: list[Fault] = []
    file, tests, right = "", (), ""
    for line in Path(__file__).with_name("faults.txt").read_text(encoding="utf-8").splitlines():
        mark, text = line[:2], line[2:]
        if mark == "- ":
            right = text
        elif mark == "+ ":
            found.append(Fault(file, right, text, tests))
        elif mark == "? ":
            found[-1] = replace(found[-1], reason=text)
        elif line and mark != "# ":
            file, _, paths = line.partition(": ")
            tests = tuple(f"tests/{path}" for path in paths.split())
    return tuple(found)


FAULTS = _read()


@dataclass(frozen=True)
class Verdict:
    """What became of a fault."""

    fault: Fault
    word: str
    """``caught``, ``no end`` (caught, too), ``survived``, or ``reason``: survived, and as good as the right line."""
    test: str = ""
    """First test that failed."""


def copy_of_the_project(folder: Path) -> Path:
    """Copy what git tracks, uncommitted changes included."""
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, tracked.split("\0")):
        target = folder / name
        if (ROOT / name).is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target)
    return folder


def run_tests(folder: Path, tests: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    """Run quick tests of a copy up to the first failure."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--cpu-limit", "1e9", *tests]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE, check=False)


def tried(folder: Path, fault: Fault, count: int) -> Verdict:
    """Put a fault into a copy, run its tests, and take it out again."""
    file = folder / fault.file
    right, stamp = file.read_text(encoding="utf-8"), file.stat().st_mtime
    file.write_text(fault.put_into(right), encoding="utf-8")
    os.utime(file, (stamp, stamp + 10.0 * count))  # bytecode is known by whole seconds and size
    try:
        done = run_tests(folder, fault.tests)
    except subprocess.TimeoutExpired:
        return Verdict(fault, "no end")
    finally:
        file.write_text(right, encoding="utf-8")
        os.utime(file, (stamp, stamp))
    if done.returncode not in (0, 1, 2):
        raise RuntimeError(
            f"{fault.name}: pytest ended with {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
        )
    if done.returncode == 0:
        return Verdict(fault, "reason" if fault.reason else "survived")
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return Verdict(fault, "caught", failed[0].split(" - ")[0] if failed else "collection")


def main() -> int:
    """Try every fault and write the report; 1 where fewer than the limit are noticed."""
    only, jobs = ("", "faults whose file name contains this"), (os.cpu_count() or 1, "")
    asked, report = begun(__doc__, "mutants", only=only, jobs=jobs)
    faults = [fault for fault in FAULTS if asked.only in fault.file]
    for fault in faults:
        fault.put_into((ROOT / fault.file).read_text(encoding="utf-8"))  # all apply, or nothing is tried
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        copies: SimpleQueue[Path] = SimpleQueue()
        for k in range(asked.jobs):
            copies.put(copy_of_the_project(Path(scratch) / str(k)))

        def one(numbered: tuple[int, Fault]) -> Verdict:
            folder = copies.get()
            try:
                verdict = tried(folder, numbered[1], numbered[0])
            finally:
                copies.put(folder)
            print(
                f"{time.monotonic() - began:6.0f} s  {verdict.word:8}  {verdict.fault.name}  {verdict.test}", flush=True
            )
            return verdict

        with ThreadPoolExecutor(asked.jobs) as pool:
            verdicts = list(pool.map(one, enumerate(faults, 1)))
    counted = [verdict for verdict in verdicts if verdict.word != "reason"]
    caught = sum(verdict.word != "survived" for verdict in counted)
    print(f"{caught} of {len(counted)} caught")
    if asked.only:
        return int(caught < CAUGHT * len(counted))
    columns = ["file", "right", "wrong", "verdict", "first test that failed, or reason"]
    rows = [[v.fault.file, v.fault.right, v.fault.wrong, v.word, v.fault.reason or v.test] for v in verdicts]
    report.table("Faults", columns, rows, "Quick tests of the module alone, up to the first failure.")
    report.claim("share of faults that are caught", caught / len(counted), ">=", CAUGHT)
    report.finish()
    return int(report.status != "all limits met")


if __name__ == "__main__":
    sys.exit(main())
