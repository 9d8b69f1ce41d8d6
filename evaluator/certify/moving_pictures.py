"""Re-exports the code that draws animated images of episodes, for the processes that `processes.renderers` starts."""

from physment_mcp.world.pictures.annotations import label_of
from physment_mcp.world.pictures.moving_plates import Moment, Shown, ShownReading, moving_plate
from physment_mcp.world.pictures.showing import ShownBody, ShownPart
from physment_mcp.world.pictures.sketch import SketchedPart

__all__ = ["Moment", "Shown", "ShownBody", "ShownPart", "ShownReading", "SketchedPart", "label_of", "moving_plate"]
