from .addon import ADDON as ADDON
from .write import FunctionalMockupUnit as FunctionalMockupUnit
from .write import export_fmu as export_fmu
