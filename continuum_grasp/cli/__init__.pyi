from .commands import app as app
from .commands import main as main
from .options import option as option
from .options import run_verb as run_verb
from .options import verb as verb
from .output import Output as Output
