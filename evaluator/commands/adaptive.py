"""`run --adaptive`: plays episodes in stages; earlier answers decide which episodes the next stage plays."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from evaluator.answers.keys import KeyRing
from evaluator.calibration.adaptive import DIFFICULTIES, AdaptiveTest, DifficultyTable, read_difficulties
from evaluator.commands.base import OptionGroup, logits
from evaluator.errors import UsageError
from evaluator.records.episode import Choice, Episode, EpisodeKey, Verdict
from evaluator.scores.grouping import Condition, condition
from evaluator.scores.scoring import strict_verdict
from evaluator.study.run_config import RunConfig
from evaluator.study.runner import Runner, missing
from evaluator.study.shards import WHOLE
from scenes import ErratumEffect, PackFiles, pack_hash
from scenes.folder import ranges


def add_adaptive_options(group: OptionGroup) -> None:
    """Declare the options of an adaptive test."""
    group.add_argument(
        "--adaptive",
        type=logits,
        metavar="SE",
        help="choose each scene by the answers before it, and stop when the ability of an agent is known to this"
        " standard error, such as 0.3 logits; no shards, no held-back seeds",
    )
    group.add_argument(
        "--difficulties",
        type=Path,
        metavar="FILE",
        help="with --adaptive: the calibration.json of `calibrate --out` with the difficulties of the scenes (default:"
        " the one that ships)",
    )


def adaptive_config(config: RunConfig, keys: KeyRing) -> tuple[RunConfig, DifficultyTable]:
    """Restrict a run to scenes of known difficulty, and read their difficulties.

    Raises:
        UsageError: Other options contradict an adaptive test, or no scene has a known difficulty.
    """
    if config.shard != WHOLE:
        raise UsageError(
            "--adaptive: each scene depends on the answers before it, so a run has no shards; play agents apart, each"
            " into a folder of its own"
        )
    if config.seed_key is not None:
        raise UsageError("--adaptive: the choice of the scenes would tell which answers on held-back seeds are right")
    packs, table = of_known_difficulty(config.packs, config.difficulties, keys)
    return replace(config, packs=packs), table


def of_known_difficulty(
    packs: Sequence[PackFiles], difficulties: Path | None, keys: KeyRing
) -> tuple[tuple[PackFiles, ...], DifficultyTable]:
    """Return the packs whose difficulty is known, and the table of difficulties. Prints the omitted scenes.

    Args:
        packs: The requested packs.
        difficulties: File of the difficulties; None for the one that ships.
        keys: Answer keys, with the information whether a pack is withdrawn.

    Raises:
        UsageError: No scene has a known difficulty, or the file cannot be read.
    """
    file = difficulties or DIFFICULTIES
    table = read_difficulties(file)
    known = tuple(
        files
        for files in packs
        if table.holds(files)
        and not ((entry := keys.erratum(pack_hash(files))) and entry.effect is ErratumEffect.WITHDRAWN)
    )
    if not known:
        raise UsageError(f"--adaptive: no scene of this run is in {file} with the pack that is here")
    left_out = sorted({files.scene_id for files in packs} - {files.scene_id for files in known})
    if left_out:
        print(
            f"physment-eval: left out, because their difficulty is not known, or their pack has changed or is"
            f" withdrawn: scenes {ranges(left_out)}",
            file=sys.stderr,
        )
    return known, table


@dataclass(slots=True)
class _Tests:
    """The adaptive tests of a run, one for each agent and condition."""

    takers: dict[Condition, AdaptiveTest]
    keys: KeyRing
    ended: set[EpisodeKey] = field(default_factory=set[EpisodeKey])
    """Episodes that have ended."""
    reasons: dict[EpisodeKey, Choice] = field(default_factory=dict[EpisodeKey, Choice])
    """Why each episode was chosen."""

    def add(self, episode: Episode) -> None:
        """Grade an ended episode, and add its answer to the taker's test unless the episode is unscored."""
        self.ended.add(episode.key)
        verdict = strict_verdict(episode, self.keys)
        if verdict is not Verdict.UNSCORED:
            self.takers[condition(episode.key)].add(episode.key, is_right=verdict is Verdict.CORRECT)

    def stage(self, at_once: int) -> list[EpisodeKey]:
        """Choose the next episodes of every taker whose test has not ended."""
        chosen = [choice for test in self.takers.values() for choice in test.choose(at_once)]
        self.reasons |= dict(chosen)
        return [key for key, _ in chosen]

    def give_up(self, stage: Sequence[EpisodeKey]) -> None:
        """End the tests of takers whose episodes could not be played in a stage."""
        for key in stage:
            if key not in self.ended:
                self.takers.pop(condition(key), None)


async def play_adaptively(
    config: RunConfig,
    table: DifficultyTable,
    runner: Runner,
    matrix: Sequence[EpisodeKey],
    done: Mapping[EpisodeKey, Episode],
    keys: KeyRing,
) -> str:
    """Play the adaptive tests of all takers in stages, with as many concurrent episodes as the run allows.

    Args:
        config: The configuration of the run.
        table: The difficulties of the scenes.
        runner: Object that plays the episodes of a stage.
        matrix: All episodes that can be chosen.
        done: Episodes that were played before.
        keys: Answer keys.

    Returns:
        Why a test did not end, as a clause; empty if all ended.
    """
    assert config.adaptive is not None
    waiting: dict[Condition, list[EpisodeKey]] = {condition(key): [] for key in matrix}
    for key in missing(matrix, done):
        waiting[condition(key)].append(key)
    tests = _Tests(
        {
            taker: AdaptiveTest(str(taker), table.difficulties, config.adaptive, those)
            for taker, those in waiting.items()
        },
        keys,
    )
    for episode in done.values():
        tests.add(episode)

    async def play(key: EpisodeKey) -> Episode:
        return (await runner.play(key)).model_copy(update={"chosen": tests.reasons[key]})

    def on_end(episode: Episode) -> None:
        tests.add(episode)
        runner.on_end(episode)

    stages, stopped = replace(runner, play=play, on_end=on_end), dict[str, None]()
    at_once = max(1, config.concurrency // len(waiting))
    while stage := tests.stage(at_once):
        if clause := await stages.run(stage):
            stopped[clause] = None
            tests.give_up(stage)
    return "; ".join(stopped)
