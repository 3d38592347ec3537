from .commands import app as app
from .commands import main as main
from .options import OF_RUNS as OF_RUNS
from .options import option as option
from .options import verb as verb
from .output import Output as Output
