"""All parts of laws by name, and those that the laws of each apparatus may have."""

from scenes.worlds.line import LINE
from scenes.worlds.modulations import COMMON_MODULATIONS, LINE_MODULATIONS, PLANE_MODULATIONS
from scenes.worlds.pairs import PAIRS
from scenes.worlds.parts import Apparatus, Form, Modulation
from scenes.worlds.plane import PLANE

FORMS = {form.name: form for form in (*PLANE, *PAIRS, *LINE)}
MODULATIONS = {part.name: part for part in (*PLANE_MODULATIONS, *LINE_MODULATIONS, *COMMON_MODULATIONS)}


def forms_of(apparatus: Apparatus) -> tuple[Form, ...]:
    """The forms that a world of this apparatus may have."""
    if not apparatus.flat:
        return LINE
    return (*PLANE, *PAIRS) if apparatus is Apparatus.PAIR else PLANE


def modulations_of(apparatus: Apparatus) -> tuple[Modulation, ...]:
    """The modulations that a world of this apparatus may have."""
    return (*(PLANE_MODULATIONS if apparatus.flat else LINE_MODULATIONS), *COMMON_MODULATIONS)
