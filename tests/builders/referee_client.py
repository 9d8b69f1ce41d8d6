"""Loads the integrations' shared client from its file, because it is installed only in their own environments."""

import functools
import importlib.util
import sys
from types import ModuleType

from tests.builders.paths import ROOT


@functools.cache
def referee_client() -> ModuleType:
    """The module `physment_referee`."""
    file = ROOT / "integrations" / "client" / "physment_referee.py"
    spec = importlib.util.spec_from_file_location("physment_referee", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
