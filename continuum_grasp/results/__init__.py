"""Results: what a run computed and how, declared once, written whole or not at all.

A result class is a `Result` that declares its arrays (`Stored`), its texts (`File`) and its pictures (`Picture`);
saving, reading, drawing, animating and conversion to tables are written here for all of them. Nothing here draws:
`continuum_grasp.plotting` does.
"""

from lazy_loader import attach_stub

__all__ = [
    "Dimension",
    "File",
    "MotionResult",
    "Picture",
    "Result",
    "Run",
    "Stored",
    "read_run",
    "save_picture",
    "write_run",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
