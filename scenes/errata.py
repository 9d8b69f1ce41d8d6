"""Known faults of published packs, identified by the hash of their content: `errata.json` beside the packs.

Records contain the hash of the pack that was played, so an entry applies to old records even after the pack was fixed.
"""

import json
from collections import Counter
from datetime import date
from enum import StrEnum
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from scenes.errors import PackError

ERRATA_FILE = "errata.json"


class ErratumEffect(StrEnum):
    """The effect of a fault on the episodes that were played on its pack."""

    WITHDRAWN = "withdrawn"
    """The episodes are unscored, because the key is wrong or the task cannot be solved."""
    NOTED = "noted"
    """The episodes keep their verdicts, and reports state the fault: the key is right, but the scene measures less than
    it should."""


class Erratum(BaseModel):
    """A known fault of a published pack."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    scene: int = Field(ge=0)
    """Id of the scene."""
    pack: str = Field(pattern=r"^c1:[0-9a-f]{12}$")
    """Content hash of the pack, as records contain it."""
    effect: ErratumEffect
    """`withdrawn` or `noted`."""
    fault: str = Field(pattern=r"^\S[^\n]*\.$", max_length=400)
    """Description of the fault, in one sentence."""
    date: date
    """Day on which the fault was confirmed."""


_ENTRIES = TypeAdapter(tuple[Erratum, ...])


def read_errata(folder: Path) -> tuple[Erratum, ...]:
    """Return the known faults of the packs in a folder; an empty result if the folder has no file of errata.

    Args:
        folder: Folder of packs.

    Raises:
        PackError: The file is malformed; the message names the entry and its field.
    """
    file = folder / ERRATA_FILE
    try:
        found = _ENTRIES.validate_python(json.loads(file.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return ()
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"]) or "(the whole file)"
        raise PackError(file, f"entry {place}: {first['msg']}") from error
    except ValueError as error:  # neither JSON nor UTF-8
        raise PackError(file, f"not JSON in UTF-8: {error}") from error
    twice = [pack for pack, count in Counter(entry.pack for entry in found).items() if count > 1]
    if twice:
        raise PackError(file, f"pack {twice[0]} has several entries; say all that is wrong with it in one")
    return found
