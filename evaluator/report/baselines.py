"""The baseline run that ships with the package: results of baseline agents on the scenes of a report.

`episodes.jsonl.xz` and `run.json` are a compressed run folder. `scores.jsonl.xz` holds the scores that reports use.
`physment-eval keep-baselines` writes all three files.
"""

import functools
import lzma
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from evaluator.answers.rewards import Chance
from evaluator.records.episode import EpisodeKey, Record
from evaluator.records.run import RunRecord
from evaluator.report.tables import DIMENSIONS, Cell, Noted, Score, Table, share_of
from evaluator.scores.dimensions import SCORING_VERSION, WEIGHTS, EpisodeScores
from evaluator.scores.grouping import ScorePoint, group_scores, held_out, skill, skill_interval
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.wording import counted_of
from evaluator.statistics.intervals import proportion

FOLDER = Path(__file__).with_name("baseline_run")
EPISODES, SCORES, RUN = "episodes.jsonl.xz", "scores.jsonl.xz", "run.json"
"""Names of the files of the baseline run."""


class BaselineScore(Record):
    """The scores of one episode of the baseline run, as far as reports use them."""

    key: EpisodeKey
    category: str
    is_correct: bool
    scores: EpisodeScores
    chance: Chance

    @classmethod
    def of(cls, row: ScoredEpisode) -> "BaselineScore":
        """The scores of an episode, without its turns."""
        return cls(key=row.key, category=row.category, is_correct=row.is_correct, scores=row.scores, chance=row.chance)


class BaselineRun(NamedTuple):
    """The record and the scores of the baseline run."""

    record: RunRecord
    scores: Sequence[BaselineScore]


@functools.cache
def baseline_run(folder: Path = FOLDER) -> BaselineRun | None:
    """Read the baseline run; None if it is missing or has another scoring version.

    Args:
        folder: Folder of the files.
    """
    if not (folder / RUN).is_file():
        return None
    lines = lzma.decompress((folder / SCORES).read_bytes()).splitlines()
    if int(lines[0]) != SCORING_VERSION:
        return None
    record = RunRecord.model_validate_json((folder / RUN).read_bytes())
    return BaselineRun(record, [BaselineScore.model_validate_json(line) for line in lines[1:]])


def write_scores(file: Path, rows: Iterable[ScoredEpisode]) -> None:
    """Write the compressed scores of the baseline run: the scoring version, then a line for each episode."""
    lines = [str(SCORING_VERSION), *(BaselineScore.of(row).model_dump_json() for row in rows)]
    file.write_bytes(packed("\n".join(lines).encode()))


def packed(content: bytes) -> bytes:
    """Compress content with xz at the highest compression level."""
    return lzma.compress(content, preset=9 | lzma.PRESET_EXTREME)


def baseline_table(packs: Mapping[str, str], run: BaselineRun | None = None) -> Table | None:
    """Return the table of the baseline agents' results in the scenes of a report; None if there are no results.

    Args:
        packs: Scene → hash of the pack that the report's runs played. Results on another version of a pack are left
            out.
        run: The baseline run; by default the one that ships with the package.
    """
    run = run or baseline_run()
    if run is None:
        return None
    known = run.record.content_hashes()
    common = {int(scene) for scene, pack in packs.items() if known.get(scene) == pack}
    rows = [row for row in run.scores if row.key.scene in common]
    if not rows:
        return None
    agents = [name for name in run.record.plan.agents if any(row.key.agent == name for row in rows)]
    seeds, budgets = (", ".join(map(str, values)) for values in (run.record.plan.seeds, run.record.plan.budgets))
    columns = ("agent", "strict", "Skill", "Gated", *_PRINTED, "Final Score", "FS*")
    return Table(
        "baselines",
        f"Baselines that ship with the package, on {len(common)} of {len(packs)} scenes",
        columns,
        [[agent, *_cells([row for row in rows if row.key.agent == agent])] for agent in agents],
        note=f"Played at seed {seeds} and budget {budgets}, on the packs of this report. batch, the best fixed list of"
        " calls, is played where a scene has one; constant, the best constant answer, where keys follow from draws by"
        " theory. greedy-design and random-design, which know the pack of a scene but not its hidden values, play the"
        " Easy scenes.",
    )


_PRINTED = {title: name for title, name in DIMENSIONS.items() if name in WEIGHTS}


def _cells(rows: Sequence[BaselineScore]) -> list[Cell]:
    own = held_out((row.key.agent, row.category, float(row.is_correct)) for row in rows)
    blind = held_out((row.key.agent, row.category, row.chance.strict) for row in rows)
    places = [(row.key.agent, row.category) for row in rows]
    points = [
        ScorePoint(row.scores, row.chance, row.key.budget, own.get(place), blind.get(place))
        for row, place in zip(rows, places, strict=True)
    ]
    found, right = group_scores(points), proportion((row.key.scene, row.is_correct) for row in rows)
    worth = found.blind_accuracy or 0.0
    ends = skill_interval(right.interval, worth)
    return [
        share_of(right),
        Noted(skill(right.share, worth), "" if ends is None else f"{ends.low:.2f} to {ends.high:.2f}"),
        _score(found.gated),
        *(
            Noted(getattr(found, name), counted_of(name, found.n_defined, found.n_numbers, len(rows)))
            for name in _PRINTED.values()
        ),
        _score(found.final_score),
        _score(found.final_score_of_defined),
    ]


def _score(value: float | None) -> Score | None:
    return None if value is None else Score(value)
