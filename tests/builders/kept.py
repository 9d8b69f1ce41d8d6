"""What a process keeps of scenes that it has opened, forgotten: the next episode of any scene is made anew."""

from physment_mcp import scene
from physment_mcp.world import loading


def forget_scenes() -> None:
    """Forget all scenes and compiled models that are kept; open episodes go on."""
    scene._SCENES.clear()  # pyright: ignore[reportPrivateUsage] - nothing but a test has a use for this
    loading.cached_model.cache_clear()
