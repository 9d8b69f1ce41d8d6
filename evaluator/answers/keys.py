"""Provides the answer key of a scene and seed. The only module that reads the private half of a pack."""

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from evaluator.answers.grading import infer_spec, listed_numbers
from evaluator.answers.laws import TrueLaw
from evaluator.answers.strict import AnswerKey
from evaluator.errors import UsageError
from evaluator.records.run import SeedOf, seed_as_recorded
from scenes import (
    Erratum,
    LabLimits,
    Pack,
    PackError,
    PackFiles,
    content_hash_of,
    default_folder,
    draw_knobs,
    drawn_mjcf,
    find_pack,
    read_errata,
    read_pack,
)
from scenes.draw import step_values
from scenes.finding import model_without_walls
from scenes.law_statements import UnstatableLawError, law_model
from scenes.protocol import AnswerValue, load_solution


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """Properties of a scene that reports and scores need."""

    name: str
    task: str
    category: str
    problem_type: str
    disabled_tools: frozenset[str]
    limits: LabLimits
    asks_for_law: bool = False


_KEPT = 20_000
"""Number of cached keys of about 1 kB each; a training run requests an unbounded number of seeds."""


class KeyRing:
    """Answer keys for one folder of packs. The 20,000 most recently used keys are cached."""

    def __init__(
        self,
        scenes_dir: Path | None = None,
        seed_of: SeedOf = seed_as_recorded,
        errata: Iterable[Erratum] | None = None,
    ) -> None:
        self._given = errata
        self.folder = scenes_dir
        """Folder of the packs; None for the packs that ship with the suite."""
        self.seed_of = seed_of
        """Recorded seed → the seed from which its variant is sampled."""
        self.key = functools.lru_cache(_KEPT)(self._key)
        self.law = functools.lru_cache(_KEPT)(self._law)
        self.facts = functools.cache(self._facts)

    @functools.cached_property
    def errata(self) -> dict[str, Erratum]:
        """Return the known faults of packs by content hash: the given ones, or those of the suite and the folder.

        Raises:
            UsageError: A file of errata is malformed.
        """
        if self._given is not None:
            return {entry.pack: entry for entry in self._given}
        folders = dict.fromkeys((default_folder(), self.folder or default_folder()))
        try:
            return {entry.pack: entry for folder in folders for entry in read_errata(folder)}
        except PackError as error:
            raise UsageError(str(error)) from error

    def erratum(self, pack: str) -> Erratum | None:
        """Return the known fault of a pack; None if none is known.

        Args:
            pack: Hash of the pack, as stored with an episode.
        """
        return self.errata.get(content_hash_of(pack))

    def _open(self, scene: int) -> tuple[PackFiles, Pack]:
        try:
            files = find_pack(scene, self.folder)
            return files, read_pack(files)
        except PackError as error:
            raise UsageError(str(error)) from error

    def _key(self, scene: int, seed: int) -> AnswerKey:
        """Return the answer key of a scene and a recorded seed.

        The pack stores the key for seed 0. For other seeds, `theory` computes it from the sampled values, or `measure`
        from a privileged engine run if there is no closed form. A key never comes from an agent's readings.

        Raises:
            UsageError: The pack is malformed, or provides no key for this seed.
        """
        files, pack = self._open(scene)
        seed = self.seed_of(scene, seed)
        stored = listed_numbers(pack.answer) if pack.answer_spec is None else pack.answer
        spec = pack.answer_spec or infer_spec(stored, pack.metadata.problem_type)
        names = {f"object_{listed.object_id}": listed.name for listed in pack.objects.values()}
        # A pack without knobs is the same at every seed.
        value = stored if seed == 0 or not pack.knobs else _drawn_value(files, pack, seed)
        try:
            steps = step_values(files, pack, draw_knobs(files, pack, seed)) if pack.steps else {}
            return AnswerKey(tuple(value) if isinstance(value, list) else value, spec, names, steps)
        except PackError as error:
            raise UsageError(str(error)) from error
        except ValueError as error:
            raise UsageError(f"{files.json}: no answer can be compared with its key at seed {seed}: {error}") from error

    def _law(self, scene: int, seed: int) -> TrueLaw | None:
        """Return a scene's law at a recorded seed; None if it asks for no law, or the law cannot be written as text.

        A law cannot be written as text if motion in the model does not follow from its laws alone. `lint` reports this.

        Raises:
            UsageError: The pack is malformed.
        """
        _, pack = self._open(scene)
        if not pack.law_answer:
            return None
        try:
            model = law_model(model_without_walls(scene, self.seed_of(scene, seed), self.folder))
        except PackError as error:
            raise UsageError(str(error)) from error
        except UnstatableLawError:
            return None
        objects = tuple(f"object_{listed.object_id}" for listed in pack.objects.values())
        return TrueLaw(model, pack.limits.lab_time if pack.limits else None, objects)

    def _facts(self, scene: int) -> SceneFacts:
        _, pack = self._open(scene)
        return SceneFacts(
            pack.metadata.scene_name,
            pack.metadata.task,
            pack.category.value if pack.category else "uncategorised",
            pack.metadata.problem_type,
            frozenset(pack.disabled_tools),
            pack.limits or LabLimits(),
            pack.law_answer,
        )


def _drawn_value(files: PackFiles, pack: Pack, seed: int) -> AnswerValue:
    try:
        solution, knobs = load_solution(files), draw_knobs(files, pack, seed)
        if solution.theory is not None:
            return solution.theory(knobs)
        if solution.measure is not None:
            from evaluator.answers.engine import Engine  # noqa: PLC0415 - only keys without `theory` need the engine

            return solution.measure(Engine(drawn_mjcf(files, pack, knobs, canonical=False)), knobs)
    except PackError as error:
        raise UsageError(str(error)) from error
    raise UsageError(f"{files.solution}: defines neither theory nor measure, so there is no key for seed {seed}")
