"""The laboratory in memory, for tests that play many episodes."""

import pytest

from evaluator.certify.in_memory import MemoryLaboratory


@pytest.fixture
def laboratory() -> type[MemoryLaboratory]:
    """From a folder of packs to what serves them."""
    return MemoryLaboratory


@pytest.fixture
def memory() -> MemoryLaboratory:
    """Serves the suite."""
    return MemoryLaboratory()
