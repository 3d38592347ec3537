from .dense_rod import DenseRod as DenseRod
from .dimensionless import RodProblem as RodProblem
from .elastica import Elastica as Elastica
from .elastica import solve_elastica as solve_elastica
from .equations import RodEquations as RodEquations
from .frequencies import natural_frequencies as natural_frequencies
