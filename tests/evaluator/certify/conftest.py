"""Laboratories in memory, for tests that play many episodes."""

import pytest

from evaluator.certify.in_memory import MemoryLaboratory


@pytest.fixture
def laboratory() -> type[MemoryLaboratory]:
    """The class of a laboratory that serves a folder of packs in memory."""
    return MemoryLaboratory


@pytest.fixture
def memory() -> MemoryLaboratory:
    """A laboratory that serves the suite in memory."""
    return MemoryLaboratory()
