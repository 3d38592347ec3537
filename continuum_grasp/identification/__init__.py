"""Parameters of a finger from measurements: shapes at rest, paths of the tip, vibrations.

The names here are loaded when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from continuum_grasp._lazy import lazy_names

_MODULES = {
    "continuum_grasp.identification.damped_sine": ("DampedSine", "fit_damped_sine"),
    "continuum_grasp.identification.data": ("Frequencies", "Poses", "Reading", "TipPath"),
    "continuum_grasp.identification.fit": ("Error", "Fit"),
    "continuum_grasp.identification.fitting": ("identify",),
    "continuum_grasp.identification.read": ("data_folder", "read_data"),
    "continuum_grasp.identification.table": ("Table", "read_table"),
    "continuum_grasp.scene.identify": ("Estimate", "IdentifyScene"),
}
__all__ = [name for names in _MODULES.values() for name in names]

if TYPE_CHECKING:
    from continuum_grasp.identification.damped_sine import DampedSine as DampedSine
    from continuum_grasp.identification.damped_sine import fit_damped_sine as fit_damped_sine
    from continuum_grasp.identification.data import Frequencies as Frequencies
    from continuum_grasp.identification.data import Poses as Poses
    from continuum_grasp.identification.data import Reading as Reading
    from continuum_grasp.identification.data import TipPath as TipPath
    from continuum_grasp.identification.fit import Error as Error
    from continuum_grasp.identification.fit import Fit as Fit
    from continuum_grasp.identification.fitting import identify as identify
    from continuum_grasp.identification.read import data_folder as data_folder
    from continuum_grasp.identification.read import read_data as read_data
    from continuum_grasp.identification.table import Table as Table
    from continuum_grasp.identification.table import read_table as read_table
    from continuum_grasp.scene.identify import Estimate as Estimate
    from continuum_grasp.scene.identify import IdentifyScene as IdentifyScene

__getattr__, __dir__ = lazy_names(__name__, _MODULES)
