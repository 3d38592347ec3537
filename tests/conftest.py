"""Fixtures for all tests."""

from __future__ import annotations

import os

import pytest

from continuum_grasp.core import compiler

# Small dense problems stall where several processes run the threads of one linear algebra library each.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


# Long functions are compiled in half the time and run half as fast, which tests do not mind.
compiler._SHORT = 1_500
compiler._LONG = 1_500


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    """Compiled code goes to a folder of this run, never to the user's cache."""
    before = os.environ.get("CONTINUUM_GRASP_CACHE")
    os.environ["CONTINUUM_GRASP_CACHE"] = str(tmp_path_factory.mktemp("compiled"))
    yield
    if before is None:
        del os.environ["CONTINUUM_GRASP_CACHE"]
    else:
        os.environ["CONTINUUM_GRASP_CACHE"] = before
