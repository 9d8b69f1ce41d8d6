"""The laboratory: one MuJoCo scene per episode, and 26 tools to experiment with, over MCP or in this process.

The names below are the public interface for Python programs; docs/how-to/use-as-a-library.md shows their use. Each is
imported at its first use, so that the command line starts without the engine.

Independent of answer keys, agents, budgets and reports.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from physment_mcp.version import __version__

if TYPE_CHECKING:
    from physment_mcp.errors import EpisodeOver, PhysMentError, RefusedCall, SceneError
    from physment_mcp.library import OpenEpisode, ToolDescription, open_episode

__all__ = [
    "EpisodeOver",
    "OpenEpisode",
    "PhysMentError",
    "RefusedCall",
    "SceneError",
    "ToolDescription",
    "__version__",
    "open_episode",
]

_MODULES = {
    "EpisodeOver": "physment_mcp.errors",
    "OpenEpisode": "physment_mcp.library",
    "PhysMentError": "physment_mcp.errors",
    "RefusedCall": "physment_mcp.errors",
    "SceneError": "physment_mcp.errors",
    "ToolDescription": "physment_mcp.library",
    "open_episode": "physment_mcp.library",
}


def __getattr__(name: str) -> Any:
    """Import a public name (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)
