"""Fixtures for all tests: where compiled code is stored, and how it is optimized."""

from __future__ import annotations

import os
import shutil
import sys
import time

import pytest

from continuum_grasp.base import InputError
from tests import remaining
from tests.remaining import pytest_sessionfinish  # noqa: F401 - a hook of pytest, found here by its name
from tests.tiers import (  # noqa: F401 - hooks of pytest, found here by their names
    pytest_addoption,
    pytest_collection_finish,
    pytest_collection_modifyitems,
    pytest_itemcollected,
    pytest_runtest_setup,
    pytest_runtest_teardown,
)

# Small dense problems stall where several processes run the threads of one linear algebra library each.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Controllers compile in a tenth of the time. ``CONTINUUM_GRASP_QUICK_COMPILE=0`` tests optimized code;
# ``.ci/run`` does so with some tests of core and controllers.
os.environ.setdefault("CONTINUUM_GRASP_QUICK_COMPILE", "1")

_UNUSED_DAYS = 7.0
"""After which compiled code of earlier runs is removed [days]: it is stored by content, so old code is never used."""


def pytest_configure(config):
    """Share compiled code between the workers of a run and from run to run; never with the user's cache."""
    remaining.pytest_configure(config)
    folder = config.cache.mkdir("continuum_grasp")
    os.environ["CONTINUUM_GRASP_CACHE"] = str(folder)
    # Tests and the package are compiled to bytecode once, not by every worker and every process that a test starts.
    sys.pycache_prefix = os.environ["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if hasattr(config, "workerinput"):
        return
    shutil.rmtree(folder / "choices", ignore_errors=True)  # found by the code under test, not by content
    oldest = time.time() - _UNUSED_DAYS * 86_400.0
    for entry in (folder / "compiled").glob("*.*"):
        if entry.stat().st_mtime < oldest:
            entry.unlink(missing_ok=True)


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    """Tests that need a solver which an older CasADi does not have are skipped there."""
    try:
        return (yield)
    except InputError as error:
        import casadi as ca  # not above: it loads numpy's linear algebra, with as many threads as are set by then

        if "needs PIQP" in str(error) and not ca.has_conic("piqp"):
            pytest.skip(str(error))
        raise
