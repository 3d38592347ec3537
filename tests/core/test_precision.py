"""C in single precision, and what it cannot hold; from inside: lines of C made here are rewritten, without a package.

C in single precision, of controllers and packages: literals, and what it cannot hold.
"""

from __future__ import annotations

import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.core.precision import single
from continuum_grasp.scene import Finger
from tests.finger_cases import ROD


def test_literals_are_rewritten_by_tokens():
    source = (
        '#include <math.h>\n/* 1.5 */ // 2.5\nreal a1e5 = 3.5, b = .5e-3 + 1. - 2e+4;\nchar *s = "4.5"; '
        "int n = 7, m = 0x1e5; float f = 1.25f; long k = 199901L;"
    )
    assert single(source).splitlines()[1:] == [
        "#include <tgmath.h>",
        "/* 1.5 */ // 2.5",
        "real a1e5 = 3.5f, b = .5e-3f + 1.f - 2e+4f;",
        'char *s = "4.5"; int n = 7, m = 0x1e5; float f = 1.25f; long k = 199901L;',
    ]


@pytest.mark.parametrize("number", ["1e39", "1e-39", "-4e+50"])
def test_constants_beyond_single_precision_are_refused(number):
    with pytest.raises(InputError, match=r"beyond single precision.*coarser accuracy"):
        single(f"a = {number};")


def test_models_compute_in_double_alone():
    model = cg.FingerModel(Finger(rod=ROD), family="arc", elements=2)
    with pytest.raises(InputError, match=r"precision: models compute in double precision; take export_c"):
        cg.compile(model, precision="float")
