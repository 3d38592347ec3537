"""``python -m continuum_grasp`` is the command line, and so is the script ``continuum-grasp``."""

from __future__ import annotations

import os


def main() -> None:
    """Run the command line; Ctrl-C is taken before anything else is imported."""
    import _signal  # type: ignore[import-not-found] # the part of signal that takes no time to import

    def end(number: int, frame: object) -> None:
        os.write(2, b"interrupted\n")
        os._exit(130)  # nothing has begun yet

    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
        _signal.signal(_signal.SIGINT, end)

    from continuum_grasp.base import ExitStatus, interruptible, leave_interrupted

    with interruptible(command=True):
        try:
            from continuum_grasp.cli import main as command

            command()
        except KeyboardInterrupt:
            os.write(2, b"interrupted\n")
            leave_interrupted()
        except SystemExit as ended:
            if ended.code == ExitStatus.INTERRUPTED:
                leave_interrupted()
            raise


if __name__ == "__main__":
    main()
