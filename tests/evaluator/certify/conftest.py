"""In-memory laboratories, for tests that play many episodes."""

import pytest

from evaluator.certify.verify import MemoryConnector


@pytest.fixture
def laboratory() -> type[MemoryConnector]:
    """The class of a laboratory that serves a folder of packs in memory."""
    return MemoryConnector


@pytest.fixture
def memory() -> MemoryConnector:
    """A laboratory that serves the suite in memory."""
    return MemoryConnector()
