"""Operations in vector lanes against numpy, at the edges of their ranges too, and elimination against LAPACK."""

from __future__ import annotations

import ctypes
import subprocess

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.core import Compiler, CSource

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")

_EDGES = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan]


def in_lanes(folder, kind, flags):
    """A call on pairs of numbers, which fill the lanes one after the other; and what it gives by numpy."""
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    found = ca.vertcat(
        ca.exp(a), ca.sqrt(a), ca.fabs(a), ca.fmin(a, b), ca.fmax(a, b), ca.if_else(a < b, a, 0), a <= b, ca.sign(a)
    )
    function = ca.Function("operations", [a, b], [ca.densify(found)])
    source = folder / "lanes.c"
    source.write_text(f"""{CSource([function], kind).lanes()}
void run(int count, const cg_real *given, cg_real *found)
{{
  for (int k = 0; k < count; k += CG_LANES) {{
    cg_lanes a[1], b[1], c[8]; const cg_lanes *in[] = {{a, b}}; cg_lanes *out[] = {{c}};
    for (int l = 0; l < CG_LANES; ++l) {{ a[0][l] = given[2 * (k + l)]; b[0][l] = given[2 * (k + l) + 1]; }}
    operations_lanes(in, out);
    for (int l = 0; l < CG_LANES; ++l)
      for (int j = 0; j < 8; ++j) found[8 * (k + l) + j] = c[j][l];
  }}
}}""")
    library = folder / "lanes.so"
    command = [*Compiler.find().command, "-std=gnu11", "-O2", "-w", *flags, "-shared", "-fPIC", source, "-o", library]
    subprocess.run([*command, "-lm"], check=True)
    run = ctypes.CDLL(str(library)).run

    def called(pairs):
        results = np.zeros((len(pairs), 8), pairs.dtype)
        run(len(pairs), ctypes.c_void_p(pairs.ctypes.data), ctypes.c_void_p(results.ctypes.data))
        return results

    return called


@pytest.mark.parametrize("flags", [(), ("-march=native",)], ids=["plain", "native"])
@pytest.mark.parametrize("kind", ["double", "float"])
def test_operations_in_lanes_are_those_of_numpy(kind, flags, tmp_path):
    number = np.dtype(kind if kind == "double" else np.float32).type
    limits = np.finfo(number)
    most, least = np.log(limits.max), np.log(limits.tiny)
    rng = np.random.default_rng(0)
    inside = np.array([[most - 1e-4, 0.0], [least + 1e-2, 0.0], [0.3, 0.3]])
    spread = rng.uniform(-1.0, 1.0, (990, 2)) * np.logspace(-8, np.log10(0.99 * most), 990)[:, None]
    beyond = np.array([[1.01 * most, 1.0], [1.3 * least, 1.0], [1e30, -1e30]])
    edges = np.array(np.meshgrid(_EDGES, _EDGES)).reshape(2, -1).T
    pairs = np.vstack([inside, spread, beyond, edges]).astype(number)
    pairs = np.ascontiguousarray(np.vstack([pairs, pairs[: -len(pairs) % 16]]))
    a, b = pairs.T
    exp, sqrt, fabs, least_of, most_of, chosen, is_less, sign = in_lanes(tmp_path, kind, flags)(pairs).T
    with np.errstate(all="ignore"):
        expected = np.exp(a)
        np.testing.assert_array_equal(sqrt, np.sqrt(a))
    whole = ~((expected > 0.0) & (expected < limits.tiny))
    np.testing.assert_allclose(exp[whole], expected[whole], rtol=2.0 * limits.eps, atol=0.0)
    np.testing.assert_array_less(np.abs(exp[~whole]), limits.tiny)
    np.testing.assert_array_equal(fabs, np.abs(a))
    ordered = ~(np.isnan(a) | np.isnan(b))
    np.testing.assert_array_equal(least_of[ordered], np.minimum(a, b)[ordered])
    np.testing.assert_array_equal(most_of[ordered], np.maximum(a, b)[ordered])
    np.testing.assert_array_equal(chosen, np.where(a < b, a, 0.0))
    np.testing.assert_array_equal(is_less, a <= b)
    np.testing.assert_array_equal(sign[ordered], np.sign(a)[ordered])
