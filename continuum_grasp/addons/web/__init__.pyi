from .addon import ADDON as ADDON
from .html_page import Page as Page
from .page import export_web as export_web
