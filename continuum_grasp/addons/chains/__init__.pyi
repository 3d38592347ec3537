from .addon import ADDON as ADDON
from .write import export_mjcf as export_mjcf
