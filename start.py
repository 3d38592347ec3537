#!/usr/bin/env python3
"""Set up continuum_grasp in a folder of its own (.venv), then run it. Needs nothing but Python 3.11 or newer.

    python3 start.py grasp configs/grasp/mug.yaml    any verb of continuum-grasp, with its options
    python3 start.py docs                            documentation and API reference as a site: build/docs/index.html
    python3 start.py jupyterlab notebooks            the notebooks in a browser
    python3 start.py install jax torch               extras of pyproject.toml, by their names
    python3 start.py test                            a few tests of each file, then all others
    python3 start.py test tests/model -x             tests with pytest's options, in one run

On Windows: py start.py. The first run installs, later runs start at once. Nothing is installed outside of .venv.
"""

# Old versions of Python must be able to read this file, to say that they are too old.

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys

ROOT = os.path.dirname(os.path.abspath(__file__))
VENV = os.path.join(ROOT, ".venv")
PYTHON = os.path.join(VENV, *(("Scripts", "python.exe") if os.name == "nt" else ("bin", "python")))
STAMP = os.path.join(VENV, "installed.json")
TOOLS = {
    "test": ("test", ["pytest", "-n", "auto", "--dist", "worksteal"], ROOT),
    "docs": ("docs", ["mkdocs", "build", "--strict"], ROOT),
    "jupyterlab": ("notebook", ["jupyterlab"], None),
}
"""What is no verb of continuum-grasp: the extra that it needs, the command that gets its options, and in which folder."""
STARTED_BY = "CONTINUUM_GRASP_STARTED_BY"
"""Variable by which the package names commands as they are typed; continuum_grasp/base/shell.py reads it."""


def main(arguments):
    """Set up what is missing, then run; the exit status is that of what was run."""
    if sys.version_info < (3, 11):
        return fail("Python 3.11 or newer is needed, this is " + sys.version.split()[0] + "; try: python3.12 start.py")
    if not arguments or arguments[0] in ("-h", "--help"):
        print(__doc__.strip())
        return 0
    if arguments[0] == "install":
        return install(arguments[1:])
    tool = TOOLS.get(arguments[0])
    if not set_up([tool[0]] if tool else []):
        return 2
    sys.stdout.flush()
    os.environ.setdefault("NO_MKDOCS_2_WARNING", "1")  # pyproject.toml asks for the versions that go together
    if tool is None:
        os.environ[STARTED_BY] = json.dumps([python_as_typed(), os.path.abspath(sys.argv[0])])
        return run([PYTHON, "-m", "continuum_grasp", *arguments])
    command = [PYTHON, "-m", *tool[1], *arguments[1:]]
    if arguments == ["test"]:
        # The first tier touches every package: a broken installation shows within three minutes.
        status = run([*command, "--tier", "first"], cwd=tool[2])
        if status > 1:  # interrupted, or pytest itself failed
            return status
        return max(status, run([*command, "--tier", "rest"], cwd=tool[2]))
    return run(command, cwd=tool[2])


def python_as_typed():
    """The word before start.py; the launcher of Windows does not pass on its own."""
    if os.name == "nt" and shutil.which("py"):
        return "py"
    word = sys.orig_argv[0]
    return os.path.abspath(word) if os.path.dirname(word) else word


def install(extras):
    """Install extras beside what is there; an unknown one is named, which pip says in a warning alone."""
    import tomllib

    with open(os.path.join(ROOT, "pyproject.toml"), "rb") as stream:
        known = tomllib.load(stream)["project"]["optional-dependencies"]
    if not extras or not set(extras) <= set(known):
        return fail("expected extras to install, of: " + ", ".join(sorted(known)))
    return 0 if set_up(extras) else 2


def run(command, cwd=None):
    """Run a command to its end; on Ctrl-C, which it gets too, that is its own, so that it can save what there is."""
    process = None

    def pressed(number, frame):
        if process is not None and os.name != "nt" and not sys.stdin.isatty():  # a terminal, or Windows, asks both
            process.send_signal(number)

    usual = signal.signal(signal.SIGINT, pressed)
    try:
        process = subprocess.Popen(command, cwd=cwd)
        status = process.wait()
    finally:
        signal.signal(signal.SIGINT, usual)
    return status if status >= 0 else 128 - status


def set_up(extras):
    """Make .venv and install into it, unless that was done for this state of the project."""
    with open(os.path.join(ROOT, "pyproject.toml"), "rb") as stream:
        state = {"project": hashlib.sha256(stream.read()).hexdigest(), "root": ROOT}
    done = read_stamp()
    usable = os.path.exists(PYTHON) and subprocess.call([PYTHON, "-c", ""]) == 0
    if usable and all(done.get(key) == value for key, value in state.items()):
        if set(extras) <= set(done.get("extras", [])):
            return True
        extras = sorted({*extras, *done["extras"]})
    print("Setting up .venv, which takes a minute or two the first time ...", file=sys.stderr, flush=True)
    pip = make_environment(usable)
    if pip is None:
        return False
    target = ROOT + ("[" + ",".join(extras) + "]" if extras else "")
    if subprocess.call([*pip, "install", "-qq", "--disable-pip-version-check", "--editable", target]) != 0:
        fail("installing failed; what pip said stands above. Without network access nothing can be installed.")
        return False
    with open(STAMP, "w", encoding="utf-8") as stream:
        json.dump({"extras": extras, **state}, stream)
    return True


def read_stamp():
    """What was installed, as noted at the end of the last installation."""
    try:
        with open(STAMP, encoding="utf-8") as stream:
            return json.load(stream)
    except (OSError, ValueError):
        return {}


def make_environment(usable):
    """Make .venv where it is missing or broken; the command of a pip that installs into it, or None."""
    own = [PYTHON, "-m", "pip"]
    if usable and works([*own, "--version"]):
        return own
    if os.path.exists(VENV):
        shutil.rmtree(VENV)
    if works([sys.executable, "-m", "venv", VENV]) and works([*own, "--version"]):
        return own
    # Debian and Ubuntu split pip off from venv; a pip of the system can install into a .venv without one.
    shutil.rmtree(VENV, ignore_errors=True)
    foreign = [sys.executable, "-m", "pip", "--python", PYTHON]
    if works([sys.executable, "-m", "venv", "--without-pip", VENV]) and works([*foreign, "--version"]):
        return foreign
    shutil.rmtree(VENV, ignore_errors=True)
    if works([sys.executable, "-m", "virtualenv", VENV]):
        return own
    fail(
        "this Python cannot make virtual environments with pip in them. On Debian and Ubuntu:\n"
        "    sudo apt install python3-venv\n"
        "and run this again."
    )
    return None


def works(command):
    """Run a command without showing what it says."""
    return subprocess.call(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 0


def fail(message):
    """Say what is wrong; the exit status for it."""
    print("error: " + message, file=sys.stderr)
    return 2


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
