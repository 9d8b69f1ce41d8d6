"""The public half of a pack: the data that a laboratory needs to host a scene, none of which reveals its answer.

An exported pack (`scenes.export`) contains only this half and the models of some seeds, for a host on another machine:
`Scene7/scene7.public.json` and `Scene7/scene7.seed0.xml`, `scene7.seed1.xml`, …
"""

import re
from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from scenes.answer_spec import AnswerKind, Variable
from scenes.draw import draw_knobs
from scenes.errors import PackError
from scenes.folder import PackFiles, ranges, read_pack
from scenes.laboratory import Instruments, LabLimits
from scenes.model import drawn_mjcf, noise_of_seed
from scenes.pack import Pack, Permissions, SchematicPart

_FILE = re.compile(r"""[\s"']file\s*=""")
"""Attributes by which a model makes MuJoCo read another file."""


def _with_prefix(written: str) -> str:
    return f"object_{written.removeprefix('object_')}"


class _Public(BaseModel):
    # An unknown key may be a private one, so it is an error here.
    model_config = ConfigDict(extra="forbid", frozen=True)


class PublicObject(_Public):
    """An object of the scene, which the agent knows from the start, or after `find_objects` if it is hidden."""

    object_id: str
    """Canonical id, such as `object_1`; also the name of its body."""
    name: str
    permissions: Permissions


class AnswerForm(_Public):
    """The form of an answer, which does not depend on the right answer."""

    kind: AnswerKind
    unit: str | tuple[str, ...] | None = None
    labels: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    variables: dict[str, Variable] = {}
    rel_tol: float = 0.05
    """Relative tolerance: a number is right if its error is at most abs_tol + rel_tol |key|."""
    abs_tol: float = 0.0


class PublicQuantity(_Public):
    """A quantity that an agent may state together with its answer."""

    name: str
    meaning: str
    unit: str


class PublicPack(_Public):
    """The fields of a pack that the laboratory may see, copied by an allow-list, so that new fields stay private."""

    scene_id: int
    name: str
    task: str
    problem_type: str
    objects: tuple[PublicObject, ...]
    answer_form: AnswerForm | None
    disabled_tools: tuple[str, ...]
    soft_objects: tuple[Annotated[str, AfterValidator(_with_prefix)], ...]
    """Canonical ids; packs may also write the number alone."""
    limits: LabLimits | None = None
    instruments: Instruments | None = None
    steps: tuple[PublicQuantity, ...] = ()
    schematic: tuple[SchematicPart, ...] = ()
    law_answer: bool = False
    """Whether an agent may state a law with its answer."""

    @classmethod
    def of(cls, scene_id: int, pack: Pack) -> Self:
        """Return the public half of a complete pack."""
        spec = pack.answer_spec
        return cls(
            scene_id=scene_id,
            name=pack.metadata.scene_name,
            task=pack.metadata.task,
            problem_type=pack.metadata.problem_type,
            objects=tuple(
                PublicObject(
                    object_id=f"object_{listed.object_id}", name=listed.name, permissions=pack.permissions_of(key)
                )
                for key, listed in pack.objects.items()
            ),
            answer_form=spec and AnswerForm(**spec.model_dump(include=set(AnswerForm.model_fields))),
            disabled_tools=tuple(pack.disabled_tools),
            soft_objects=pack.soft_objects,
            limits=pack.limits,
            instruments=pack.instruments,
            steps=tuple(
                PublicQuantity(name=name, meaning=step.meaning, unit=step.unit) for name, step in pack.steps.items()
            ),
            schematic=pack.schematic,
            law_answer=pack.law_answer,
        )


def read_public(files: PackFiles) -> PublicPack:
    """The public half of a complete or an exported pack.

    Raises:
        PackError: A file is missing or malformed, or lies outside the folder of packs.
    """
    path = exported_json(files)
    if not path.is_file():
        files.check_inside(files.json)
        return PublicPack.of(files.scene_id, read_pack(files))
    files.check_inside(path)
    try:
        return PublicPack.model_validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"]) or "(the whole file)"
        raise PackError(path, f"field {field}: {first['msg']}") from error


def hosted_files(files: PackFiles, seed: int) -> tuple[Path, Path]:
    """Return the two files that `read_hosted` reads, of a complete or an exported pack.

    Raises:
        PackError: One of them is outside the folder of packs, or the seed was not exported.
    """
    public, path = exported_json(files), exported_mjcf(files, seed)
    if not public.is_file():
        files.check_inside(files.json, files.mjcf)
        return files.json, files.mjcf
    files.check_inside(public, path)
    if not path.is_file():
        raise PackError(files.folder, f"seed {seed} was not exported; there are the seeds {ranges(_seeds(files))}")
    return public, path


def read_hosted(files: PackFiles, seed: int) -> tuple[PublicPack, str]:
    """The public half of a complete or an exported pack, and the model of a seed.

    Raises:
        PackError: A file is missing, malformed or outside the folder of packs, or the seed was not exported.
    """
    description, model = hosted_files(files, seed)
    if description == exported_json(files):
        public, mjcf = read_public(files), model.read_text(encoding="utf-8")
    else:
        pack = read_pack(files)
        public = PublicPack.of(files.scene_id, pack)
        mjcf = noise_of_seed(drawn_mjcf(files, pack, draw_knobs(files, pack, seed), canonical=seed == 0), seed)
    if _FILE.search(mjcf):
        raise PackError(files.mjcf, "the model names another file, and a pack is whole in itself")
    return public, mjcf


def exported_json(files: PackFiles) -> Path:
    """Return the path of the public half of an exported pack. Complete packs have no such file."""
    return files.folder / f"scene{files.scene_id}.public.json"


def exported_mjcf(files: PackFiles, seed: int) -> Path:
    """Return the path of the model of an exported pack for a seed."""
    return files.folder / f"scene{files.scene_id}.seed{seed}.xml"


def _seeds(files: PackFiles) -> list[int]:
    pattern = re.compile(rf"scene{files.scene_id}\.seed(-?\d+)\.xml")
    return sorted(int(match[1]) for path in files.folder.iterdir() if (match := pattern.fullmatch(path.name)))
