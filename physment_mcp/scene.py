"""A pack as the laboratory sees it: the public half, picked field by field, and the model with the drawn values in it.

A private key added to packs tomorrow stays private: nothing is passed on that `scenes.public` does not name.
"""

import logging
from dataclasses import dataclass
from pathlib import Path

from physment_mcp.errors import SceneError
from scenes import PackError, Permissions, find_pack, list_packs, read_hosted, read_public

logger = logging.getLogger(__name__)


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
class SceneCard:
    """What may be told of a scene before it is opened."""

    scene_id: int
    name: str
    problem_type: str
    task: str


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

    @property
    def card(self) -> SceneCard:
        """What may be told of it before it is opened."""
        return SceneCard(self.scene_id, self.name, self.problem_type, self.task)


def load_scene(scene_id: int, seed: int = 0, folder: Path | None = None) -> Scene:
    """Read the public half of a scene and draw its hidden values.

    Args:
        scene_id: Id of the scene, 7 to 111 in the suite.
        seed: 0 for the scene as written, any other whole number for a variant of it.
        folder: Folder of packs, whole or exported; the installed suite by default.

    Raises:
        SceneError: There is no such scene, or its pack is malformed or outside the folder.
    """
    try:
        files = find_pack(scene_id, folder)
    except PackError as error:
        raise SceneError(str(error), told=error.problem) from error
    try:
        public, mjcf = read_hosted(files, seed)
    except PackError as error:
        raise SceneError(str(error)) from error
    form = public.answer_form
    return Scene(
        scene_id=scene_id,
        name=public.name,
        task=public.task,
        problem_type=public.problem_type,
        objects=tuple(ListedObject(one.object_id, one.name, one.permissions) for one in public.objects),
        answer_form=form and AnswerForm(form.kind.value, form.unit, form.labels, form.options),
        disabled_tools=frozenset(public.disabled_tools),
        soft_objects=frozenset(
            f"object_{number}".replace("object_object_", "object_") for number in public.soft_objects
        ),
        mjcf=mjcf,
    )


def load_variants(scene_id: int, folder: Path | None = None) -> list[str]:
    """The models of a scene at seeds 0 to 19; a choice of two survives so many draws unseen once in 500 000.

    Raises:
        SceneError: One of them cannot be read, as where an exported pack lacks the seed.
    """
    try:
        files = find_pack(scene_id, folder)
        return [read_hosted(files, seed)[1] for seed in range(20)]
    except PackError as error:
        raise SceneError(f"frames need the seeds 0 to 19 of a scene: {error}") from error


def scene_ids(folder: Path | None = None) -> list[int]:
    """Ids of the scenes in a folder, ascending.

    Raises:
        SceneError: There is no such folder, or it holds no pack.
    """
    try:
        return [files.scene_id for files in list_packs(folder)]
    except PackError as error:
        raise SceneError(str(error)) from error


def list_cards(folder: Path | None = None) -> list[SceneCard]:
    """What may be told of the scenes in a folder, by ascending id; a pack that cannot be read is left out and logged.

    Raises:
        SceneError: There is no such folder, or it holds no pack.
    """
    cards: list[SceneCard] = []
    for scene_id in scene_ids(folder):
        try:
            public = read_public(find_pack(scene_id, folder))
        except PackError as error:
            logger.warning("scene %d is not listed: %s", scene_id, error)
            continue
        cards.append(SceneCard(scene_id, public.name, public.problem_type, public.task))
    return cards
