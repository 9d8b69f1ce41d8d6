"""Records of accepted worlds: one line of JSON each, with answer keys and certificates in separate files.

`level-5.jsonl` contains the data of the packs, `level-5.keys.jsonl` the answer key and the certificate of each line. A
record names the version of the grammar and the settings with which the world was sampled. Its certificate contains the
hash of the record. In a published set both files begin with a line that contains the canary of the suite, and
certificates are in the folder `keys`, so that a laboratory can be installed without them.
"""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from scenes.errors import WorldError
from scenes.pack import CANARY
from scenes.world_names import LEVEL_IDS, scene_id_of
from scenes.worlds.acceptance import DrawnWorld
from scenes.worlds.catalogue import forms_of, modulations_of
from scenes.worlds.experiment import Situation
from scenes.worlds.levels import GRAMMAR, LEVELS
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question
from scenes.worlds.terms import Structure, Term

CANARY_LINE = f'{{"canary":"{CANARY}"}}\n'
"""First line of the files of a published set, so that corpora can filter them out."""


class _Line(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @property
    def digest(self) -> str:
        """A short hash of the record's line. Fields that are added later do not change it."""
        return hashlib.sha256(as_line(self).encode()).hexdigest()[:16]


_L = TypeVar("_L", bound=_Line)


class WorldRecord(_Line):
    """The data from which the laboratory of a world is generated."""

    grammar: int = Field(ge=1, le=GRAMMAR)
    level: int = Field(ge=LEVELS[0], le=LEVELS[-1])
    index: int = Field(ge=0, lt=LEVEL_IDS)
    split: str
    settings: tuple[str, ...] = ()
    """Attributes that differ from those of its level, such as `terms=4`, as `worlds make --set` takes them."""
    commitment: str = ""
    """Commitment to the key from which the world was drawn; empty for public worlds."""
    salt: str
    """Secret text that determines the noise of the instruments."""
    apparatus: Apparatus
    terms: tuple[tuple[str, tuple[str, ...]], ...]
    constants: dict[str, float]
    radius: float = Field(gt=0)
    force: float = Field(gt=0)
    looks: int = Field(ge=2, le=1000)
    noise: float = Field(ge=0)
    bias: float = Field(default=0.0, ge=0)
    """Bound that the prompt states for the bias of the position instrument [m, rad]. `constants` contains the bias."""
    drift: float = Field(default=0.0, ge=0)
    """Bound that the prompt states for the drift of the position instrument [m/s, rad/s]."""
    questions: tuple[Question, ...]

    @model_validator(mode="after")
    def _is_of_the_grammar(self) -> Self:
        forms = {form.name for form in forms_of(self.apparatus)}
        factors = {part.name for part in modulations_of(self.apparatus)}
        if not all(form in forms and factors.issuperset(names) for form, names in self.terms):
            msg = f"a {self.apparatus} has no such part; is the record of a newer version?"
            raise ValueError(msg)
        if self.constants.keys() != {*self.structure.ranges, *self.told.errors}:
            msg = "the constants are not those of the terms"
            raise ValueError(msg)
        bounds = np.repeat([self.bias, self.drift], self.told.width)[: len(self.told.errors)]
        if any(abs(self.constants[name]) > bound for name, bound in zip(self.told.errors, bounds, strict=True)):
            msg = "an error of the position instrument is larger than the prompt admits"
            raise ValueError(msg)
        size = self.structure.controls
        if any({len(one.place), len(one.speed), len(one.push)} != {size} for one in self.questions):
            msg = f"a question needs {size} components of place, speed and push"
            raise ValueError(msg)
        return self

    @classmethod
    def of(cls, world: DrawnWorld, level: int, index: int, split: str, salt: str, **drawn: Any) -> Self:
        """Return the record of an accepted world.

        Args:
            world: The world.
            level: Its level.
            index: Its number.
            split: The split of its structure.
            salt: Salt of the instrument noise.
            **drawn: How the world was sampled: `settings` and `commitment`.
        """
        terms = tuple((term.form, term.modulations) for term in world.structure.terms)
        told = asdict(world.told)
        return cls(
            grammar=GRAMMAR, level=level, index=index, split=split, salt=salt, terms=terms,
            constants=dict(world.constants), questions=world.questions, **told, **drawn,
        )  # fmt: skip

    @property
    def structure(self) -> Structure:
        """Return the structure: the terms of the law."""
        return Structure(self.apparatus, tuple(Term(form, names) for form, names in self.terms), self.radius)

    @property
    def told(self) -> Situation:
        """Return the information in the prompt: apparatus, limits and instruments."""
        return Situation(self.apparatus, self.radius, self.force, self.looks, self.noise, self.bias, self.drift)

    @property
    def scene_id(self) -> int:
        """Scene id of the world."""
        return scene_id_of(self.level, self.index)


class Certificate(_Line):
    """The answer key and the certificate of a world, for graders only."""

    index: int
    record: str
    """Hash of the record."""
    key: tuple[float, ...]
    bounds: tuple[float, ...]
    """Smallest possible standard error of each answer, in tolerances."""
    engine: tuple[float, ...] = ()
    """Distance of the engine's answers from the key, in tolerances; empty before the engine was run."""
    half_step: tuple[float, ...] = ()
    """As `engine`, at half the time step."""
    draws: int = 1
    """Number of draws until one was accepted."""


def lines_file(folder: Path, level: int) -> Path:
    """The file with the records of a level in a folder of worlds."""
    return folder / f"level-{level}.jsonl"


def keys_file(folder: Path, level: int) -> Path:
    """The file with the certificates of a level: next to the records, or in the folder `keys` of a published set."""
    published = folder / "keys" / f"level-{level}.keys.jsonl"
    return published if published.exists() else folder / published.name


def read_records(folder: Path, level: int) -> Iterator[WorldRecord]:
    """The records of a level in a folder of worlds, in the order of the file.

    Raises:
        WorldError: There are none, or a line is not a record of this level.
    """
    return _of_level(_read(lines_file(folder, level), WorldRecord), folder, level)


def read_record(folder: Path, level: int, index: int) -> WorldRecord | None:
    """Return one record of a level; None if there is none. Other lines are not parsed, to save time.

    Raises:
        WorldError: As for `read_records`.
    """
    found = _read(lines_file(folder, level), WorldRecord, f'"index":{index},')
    return next((record for record in _of_level(found, folder, level) if record.index == index), None)


def read_certificate(folder: Path, level: int, index: int) -> Certificate | None:
    """The last certificate of a world; None if there is none.

    Raises:
        WorldError: A line is not a certificate.
    """
    if not keys_file(folder, level).exists():
        return None
    last: Certificate | None = None
    for one in _read(keys_file(folder, level), Certificate, f'"index":{index},'):
        last = one if one.index == index else last
    return last


def _of_level(records: Iterator[WorldRecord], folder: Path, level: int) -> Iterator[WorldRecord]:
    for record in records:
        if record.level != level:
            raise WorldError(f"{lines_file(folder, level)} holds a world of level {record.level}")
        yield record


def read_certificates(folder: Path, level: int) -> Iterator[Certificate]:
    """The certificates of a level in a folder of worlds.

    Raises:
        WorldError: There are none, or a line is not a certificate.
    """
    return _read(keys_file(folder, level), Certificate)


def _read(path: Path, kind: type[_L], marked: str = "") -> Iterator[_L]:
    """Return the complete lines of a file, or only those that contain a text."""
    number = 0
    try:
        with path.open(encoding="utf-8") as file:
            for number, line in enumerate(file, 1):  # noqa: B007 - named if the line is no record
                if line.endswith("\n") and marked in line and line != CANARY_LINE:
                    yield kind.model_validate_json(line)
    except FileNotFoundError as error:
        raise WorldError(f"{path}: there are no such worlds; `physment-eval worlds make` makes them") from error
    except OSError as error:
        raise WorldError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise WorldError(f"{path} cannot be read: it is not UTF-8") from error
    except ValidationError as error:
        raise WorldError(f"{path}, line {number}: {_first(error)}") from error


def _first(error: ValidationError) -> str:
    found = error.errors(include_url=False)[0]
    return f"{'.'.join(map(str, found['loc'])) or 'the line'}: {found['msg']}"


def as_line(record: BaseModel) -> str:
    """Serialise a record or a certificate as a line, without default values and the line feed."""
    return json.dumps(record.model_dump(mode="json", exclude_defaults=True), separators=(",", ":"), ensure_ascii=False)
