"""A pack as the laboratory sees it: the public half, picked field by field, and the model with the drawn values in it.

A private key added to packs tomorrow stays private: nothing is passed on that is not named here.
"""

from dataclasses import dataclass
from pathlib import Path

from physment_mcp.errors import SceneError
from scenes import PackError, Permissions, draw_knobs, drawn_mjcf, find_pack, list_packs, read_pack


@dataclass(frozen=True, slots=True)
class ListedObject:
    """An object of the scene, known to the agent from the start or after `find_objects`."""

    object_id: str
    """Canonical id, such as `object_1`; also the name of its body."""
    name: str
    permissions: Permissions


@dataclass(frozen=True, slots=True)
class AnswerForm:
    """What an answer must look like; says nothing of its value."""

    kind: str
    unit: str | tuple[str, ...] | None
    labels: tuple[str, ...]
    options: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Scene:
    """The public half of a pack at one seed. `mjcf` is for the world alone."""

    scene_id: int
    name: str
    task: str
    problem_type: str
    objects: tuple[ListedObject, ...]
    answer_form: AnswerForm | None
    disabled_tools: frozenset[str]
    soft_objects: frozenset[str]
    mjcf: str


def load_scene(scene_id: int, seed: int = 0, folder: Path | None = None) -> Scene:
    """Read the public half of a scene and draw its hidden values.

    Args:
        scene_id: Id of the scene, 7 to 111 in the suite.
        seed: 0 for the scene as written, any other whole number for a variant of it.
        folder: Folder of packs; the installed suite by default.

    Raises:
        SceneError: There is no such scene, or its pack is malformed.
    """
    try:
        files = find_pack(scene_id, folder)
        pack = read_pack(files)
        mjcf = drawn_mjcf(files, pack, draw_knobs(files, pack, seed), canonical=seed == 0)
    except PackError as error:
        raise SceneError(str(error)) from error
    spec = pack.answer_spec
    return Scene(
        scene_id=scene_id,
        name=pack.metadata.scene_name,
        task=pack.metadata.task,
        problem_type=pack.metadata.problem_type,
        objects=tuple(
            ListedObject(f"object_{listed.object_id}", listed.name, pack.permissions_of(key))
            for key, listed in pack.objects.items()
        ),
        answer_form=spec and AnswerForm(spec.kind.value, spec.unit, spec.labels, spec.options),
        disabled_tools=frozenset(pack.disabled_tools),
        soft_objects=frozenset(f"object_{number}".replace("object_object_", "object_") for number in pack.soft_objects),
        mjcf=mjcf,
    )


def scene_ids(folder: Path | None = None) -> list[int]:
    """Ids of the scenes in a folder, ascending.

    Raises:
        SceneError: There is no such folder, or it holds no pack.
    """
    try:
        return [files.scene_id for files in list_packs(folder)]
    except PackError as error:
        raise SceneError(str(error)) from error
