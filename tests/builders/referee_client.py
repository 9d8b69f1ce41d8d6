"""Imports the modules of `integrations/client` by file path, because they are not installed in this environment."""

import functools
import importlib.util
import sys
from types import ModuleType

from tests.builders.paths import ROOT


@functools.cache
def client_module(name: str) -> ModuleType:
    """A module of `integrations/client`."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "integrations" / "client" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def referee_client() -> ModuleType:
    """The module `physment_referee`."""
    return client_module("physment_referee")


def laboratory_client() -> ModuleType:
    """The module `physment_laboratory`."""
    return client_module("physment_laboratory")
