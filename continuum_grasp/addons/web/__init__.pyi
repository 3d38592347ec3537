from .addon import ADDON as ADDON
from .page import Page as Page
from .page import export_web as export_web
