"""Clears the caches of scenes and compiled models, so that the next episode loads its scene again."""

from physment_mcp import scene
from physment_mcp.world import loading


def forget_scenes() -> None:
    """Clear the caches of scenes and compiled models. Open episodes are not affected."""
    scene._SCENES.clear()  # pyright: ignore[reportPrivateUsage] - only tests need to clear it
    loading.cached_model.cache_clear()
