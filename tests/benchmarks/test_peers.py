"""The other libraries' release of a rod, where an interpreter with them is named."""

from __future__ import annotations

import pytest

from benchmarks.baselines import VARIABLE, PeerError
from benchmarks.baselines.release_peers import ReleasePeers


def test_without_an_interpreter_it_says_which_variable_to_set(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(PeerError, match=VARIABLE):
        ReleasePeers()
