from .addon import ADDON as ADDON
from .write import FunctionalMockupUnit as FunctionalMockupUnit
from .write import export_fmu as export_fmu
from .write import identifier_of as identifier_of
