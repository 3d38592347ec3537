"""The class of exports, for the command line."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar


class ExportTarget(ABC):
    """An export, for a word of ``continuum-grasp export --to``; one is made where the word is used.

    Attributes
    ----------
    suffix : str
        End of the file's name; empty where a folder is written.
    takes_loops : bool
        Whether closed loops and missions can be exported, or simulated scenes alone.
    takes_hands : bool
        Whether hands, and the folders of their grasps, can be exported.
    """

    suffix: ClassVar[str] = ""
    takes_loops: ClassVar[bool] = True
    takes_hands: ClassVar[bool] = False

    @property
    @abstractmethod
    def write(self) -> Callable[..., Any]:
        """Function (scene, path, **options); its parameters determine which options of ``export`` it gets."""

    @abstractmethod
    def report(self, written: Any, output: Any) -> None:
        """Print the written files, by the `Output` of the command line."""

    def defaults(self, config: Path, scene: Any) -> dict[str, Any]:
        """Options of a configuration that are not given."""
        return {}

    def check(self, scene: Any, path: Path, **options: Any) -> None:
        """Refuse arguments of ``write`` that are clearly wrong before the grasp of a mission is optimized."""
        return None

    def page_maker(self, kind: str) -> Callable[[Any], Any] | None:
        """Function from a result of a ``motion``, ``loop`` or ``hand`` to its page; None without a page."""
        return None
