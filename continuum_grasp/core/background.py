"""Libraries that are compiled while a process goes on: later processes find them in the cache."""

from __future__ import annotations

from contextlib import suppress
from queue import SimpleQueue
from threading import Lock, Thread

from continuum_grasp.core.compiler import CompileError, Compiler


class Background:
    """Compiles sources one after the other in a thread, which ends with the process: what it has compiled lasts."""

    _waiting: SimpleQueue[tuple[Compiler, str, str]] = SimpleQueue()
    _lock = Lock()
    _thread: Thread | None = None

    @classmethod
    def compiles(cls, compiler: Compiler, source: str, what: str) -> None:
        """Put a C source, which the log calls ``what``, at the end of the queue."""
        cls._waiting.put((compiler, source, what))
        with cls._lock:
            if cls._thread is None or not cls._thread.is_alive():  # a forked process has no threads of its parent
                cls._thread = Thread(target=cls._run, name="compiler", daemon=True)
                cls._thread.start()

    @classmethod
    def _run(cls) -> None:
        while True:
            compiler, source, what = cls._waiting.get()
            # Without the library, functions are interpreted: as in the process that asks for it.
            with suppress(CompileError, OSError):
                compiler.library(source, what)
