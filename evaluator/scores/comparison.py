"""Compares two runs on their common episodes: which is better, by how much, and with what certainty."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Literal, NamedTuple

from pydantic import Field

from evaluator.errors import UsageError
from evaluator.records.episode import Grade, Record, Verdict, is_absent
from evaluator.scores.grouping import modality, problem_kind, quadrant
from evaluator.scores.scored_episode import EvidenceSummary, LawSummary, ScoredEpisode, evidence_summary, law_summary
from evaluator.statistics.paired import LEVEL, PairedDifference, PairedTest, holm, paired_difference
from scenes import content_hash_of

CONDITIONS = ("agent", "budget", "prompting", "protocol")
"""Conditions in which two runs may differ as a whole. The episodes of a pair always share scene, seed and epoch."""

_GROUPINGS: Mapping[str, Callable[[ScoredEpisode], str]] = {
    "agent": lambda row: row.key.agent,
    "budget": lambda row: str(row.key.budget),
    "prompting": lambda row: row.key.prompting,
    "protocol": lambda row: row.key.protocol,
    "problem kind": lambda row: problem_kind(row.problem_type),
    "problem type": lambda row: row.problem_type,
    "difficulty and breadth": lambda row: quadrant(row.category),
    "modality": lambda row: modality(row.category),
    "category": lambda row: row.category,
}
_TESTS = {
    PairedTest.MCNEMAR: "exact McNemar test",
    PairedTest.SIGN_FLIP: "exact sign-flip test by scene",
}
_NAMED = 12
"""Largest number of scenes, or other values, that an error message lists."""


class Side(NamedTuple):
    """One of the two runs."""

    name: str
    """Its label if the two runs have equal conditions, such as the name of its folder."""
    rows: Sequence[ScoredEpisode]
    presentation: tuple[str, ...] = ()
    """Changes of the presentation that its agents received; see `evaluator.agents.presentation`."""


class GroupDifference(Record):
    """The comparison within one group of episodes."""

    grouping: str
    group: str
    difference: PairedDifference
    p_adjusted: float
    """p adjusted by Holm's method over the groups of this grouping."""


class Comparison(Record):
    """The result of comparing two runs; every difference is B minus A."""

    format: Literal[1] = 1
    a: str
    """Label of the first run."""
    b: str
    """Label of the second."""
    better: Literal["a", "b"] | None
    """None if the difference is not significant at the 5 % level."""
    sentence: str
    strict: PairedDifference
    normalised: PairedDifference
    groups: tuple[GroupDifference, ...]
    """Differences of strict accuracy, for each grouping that has more than one group."""
    evidence_a: EvidenceSummary | None = Field(default=None, exclude_if=is_absent)
    """Verdicts on the evidence of the paired episodes of A; absent if none was measured."""
    evidence_b: EvidenceSummary | None = Field(default=None, exclude_if=is_absent)
    """Verdicts on the evidence of the paired episodes of B; absent if none was measured."""
    laws_a: LawSummary | None = Field(default=None, exclude_if=is_absent)
    """Summary of the laws stated in the paired episodes of A; absent if their scenes ask for none."""
    laws_b: LawSummary | None = Field(default=None, exclude_if=is_absent)
    """Summary of the laws stated in the paired episodes of B; absent if their scenes ask for none."""
    only_a: int
    """Episodes of A without a counterpart in B; they are left out."""
    only_b: int
    """Episodes of B without a counterpart in A; they are left out."""
    unscored: int
    """Pairs left out because one of the two episodes has no verdict."""


def compare(a: Side, b: Side) -> Comparison:
    """Compare two runs, pair by pair.

    If each run has a single value of a condition (agent, budget, prompting, protocol), the two values may differ, and
    the comparison is between them. If either run has several values of a condition, the episodes of a pair must share
    its value.

    Raises:
        UsageError: The runs share no episode; a common episode was played on different packs or graded by different
            rules; the common episodes mix open worlds with other scenes; or an agent could read the packs.
    """
    for side in (a, b):
        _refuse_unsealed(side)
    whole = [name for name in CONDITIONS if all(len(_values(side, name)) == 1 for side in (a, b))]
    paired_by = [name for name in ("scene", "seed", "epoch", *CONDITIONS) if name not in whole]
    firsts, seconds = (_by_key(side, paired_by) for side in (a, b))
    common = sorted(set(firsts) & set(seconds), key=str)
    if not common:
        raise UsageError(_nothing_common(a, b, paired_by))
    pairs = [(firsts[key], seconds[key]) for key in common]
    _refuse_two_tracks(pairs, a, b)
    _refuse_other_tasks(pairs, a, b)
    scored = [(first, second) for first, second in pairs if first.is_scored and second.is_scored]
    if not scored:
        raise UsageError(f"{a.name} and {b.name}: an infrastructure error ended every episode they have in common")
    strict = _difference(scored, lambda grade: grade.strict)
    labels = _labels(a, b, whole)
    better = None if strict.p_value > LEVEL else "b" if strict.difference > 0 else "a"
    return Comparison(
        a=labels[0],
        b=labels[1],
        better=better,
        sentence=_sentence(labels, strict, better),
        strict=strict,
        normalised=_difference(scored, lambda grade: grade.normalised),
        groups=tuple(found for name, group in _GROUPINGS.items() for found in _grouped(scored, name, group)),
        evidence_a=evidence_summary(first.measured for first, _ in scored if first.measured),
        evidence_b=evidence_summary(second.measured for _, second in scored if second.measured),
        laws_a=law_summary(first.stated for first, _ in scored if first.stated),
        laws_b=law_summary(second.stated for _, second in scored if second.stated),
        only_a=len(firsts) - len(common),
        only_b=len(seconds) - len(common),
        unscored=len(pairs) - len(scored),
    )


_Pair = tuple[ScoredEpisode, ScoredEpisode]


def _values(side: Side, name: str) -> list[str]:
    return sorted({str(getattr(row.key, name)) for row in side.rows})


def _by_key(side: Side, names: Iterable[str]) -> dict[tuple[object, ...], ScoredEpisode]:
    return {tuple(getattr(row.key, name) for name in names): row for row in side.rows}


def _difference(pairs: Iterable[_Pair], verdict: Callable[[Grade], Verdict]) -> PairedDifference:
    return paired_difference(
        (a.key.scene, verdict(a.grade) is Verdict.CORRECT, verdict(b.grade) is Verdict.CORRECT) for a, b in pairs
    )


def _grouped(pairs: Sequence[_Pair], grouping: str, group: Callable[[ScoredEpisode], str]) -> list[GroupDifference]:
    groups: defaultdict[str, list[_Pair]] = defaultdict(list)
    for a, b in pairs:
        groups[group(a)].append((a, b))
    # A single group would repeat the overall difference.
    if len(groups) < 2:
        return []
    names = sorted(groups, key=lambda name: (len(name), name) if name.isdecimal() else (0, name))
    differences = [_difference(groups[name], lambda grade: grade.strict) for name in names]
    adjusted = holm([difference.p_value for difference in differences])
    return [
        GroupDifference(grouping=grouping, group=name, difference=difference, p_adjusted=p)
        for name, difference, p in zip(names, differences, adjusted, strict=True)
    ]


def _refuse_unsealed(side: Side) -> None:
    for agent in _values(side, "agent"):
        if agent.startswith("external-unsealed:"):
            raise UsageError(f"{side.name}: {agent} could read the packs, so its results compare with nothing")


def _refuse_two_tracks(pairs: Sequence[_Pair], a: Side, b: Side) -> None:
    """Raise if the common scenes include both open worlds and scenes of the suite, because no score covers both."""
    open_worlds = _scenes(pair for pair in pairs if pair[0].is_open)
    if open_worlds and len(open_worlds) < len(_scenes(pairs)):
        raise UsageError(
            f"{a.name} and {b.name} have open worlds and scenes of the suite in common, which are compared apart;"
            f" leave the open worlds out with --without {','.join(map(str, open_worlds))}, or the suite"
        )


def _refuse_other_tasks(pairs: Sequence[_Pair], a: Side, b: Side) -> None:
    """Raise if a pair was played on different packs, or graded by different rules or against different keys."""
    packs = [pair for pair in pairs if len({content_hash_of(row.episode.versions.pack) for row in pair}) > 1]
    if packs:
        scenes = _scenes(packs)
        raise UsageError(
            f"{a.name} and {b.name} were played on different packs of {_named(scenes)}, which are not the same tasks;"
            f" leave them out with --without {','.join(map(str, scenes))}"
        )
    graders = sorted({row.record.grader_version for pair in pairs for row in pair})
    if len(graders) > 1:
        raise UsageError(
            f"{a.name} and {b.name} were graded by different versions of the grader ({', '.join(graders)});"
            " run `physment-eval grade` on both"
        )
    keys = [(first, second) for first, second in pairs if first.record.answer_key != second.record.answer_key]
    if keys:
        raise UsageError(
            f"{a.name} and {b.name} were graded against different keys of {_named(_scenes(keys))};"
            " run `physment-eval grade` on both"
        )


def _scenes(pairs: Iterable[_Pair]) -> list[int]:
    return sorted({first.key.scene for first, _ in pairs})


def _named(scenes: Sequence[int]) -> str:
    more = f" and {len(scenes) - _NAMED} more" if len(scenes) > _NAMED else ""
    return f"{'scene' if len(scenes) == 1 else 'scenes'} {', '.join(map(str, scenes[:_NAMED]))}{more}"


def _nothing_common(a: Side, b: Side, paired_by: Iterable[str]) -> str:
    """Explain why the runs have no common episode: the first property without a common value."""
    for side in (a, b):
        if not side.rows:
            return f"{side.name} holds no episodes, or none of those chosen"
    for name in paired_by:
        first, second = _values(a, name), _values(b, name)
        if not set(first) & set(second):
            choose = f"; choose one of each with --a {name}=… --b {name}=…" if name in CONDITIONS else ""
            values = f"{name} {_listed(first)} against {_listed(second)}"
            return f"{a.name} and {b.name} have no episode in common: {values}{choose}"
    return f"{a.name} and {b.name} have no episode in common: no {', '.join(paired_by)} is the same in both"


def _listed(values: Sequence[str]) -> str:
    return ", ".join(values[:_NAMED]) + (" …" if len(values) > _NAMED else "")


def _labels(a: Side, b: Side, whole: Sequence[str]) -> tuple[str, str]:
    """Return a label for each run: its agent and the conditions that differ; the run's name if no condition differs."""
    differing = [name for name in whole if _values(a, name) != _values(b, name)]

    def label(side: Side) -> str:
        conditions = ", ".join(
            f"{name} {_values(side, name)[0]}" if name == "budget" else _values(side, name)[0]
            for name in differing
            if name != "agent"
        )
        if a.presentation != b.presentation:
            met = f"presentation {', '.join(side.presentation)}" if side.presentation else "as presented"
            conditions = ", ".join(filter(None, (conditions, met)))
        agent = _values(side, "agent")[0] if "agent" in whole else side.name
        return f"{agent} ({conditions})" if conditions else agent

    if differing or a.presentation != b.presentation:
        return label(a), label(b)
    return (a.name, b.name) if a.name != b.name else (f"{a.name} (first)", f"{b.name} (second)")


def _sentence(labels: tuple[str, str], found: PairedDifference, better: str | None) -> str:
    """State which run is better on which episodes, by how much, and with what certainty."""
    episodes = f"{found.n} common episode{'s' if found.n != 1 else ''}"
    scenes = f"{found.n_scenes} scene{'s' if found.n_scenes != 1 else ''}"
    # The better run comes first, but the difference is always B minus A.
    ahead = 0 if found.difference < 0 else 1
    first, second = (f"{labels[side]} ({'AB'[side]})" for side in (ahead, 1 - ahead))
    shares = [f"{100 * correct / found.n:.1f} %" for correct in (found.first_correct, found.second_correct)]
    gap = f"B − A = {points(found.difference)} points"
    if found.interval is not None:
        gap += f" (95 % interval {points(found.interval.low)} to {points(found.interval.high)})"
    chance = f"p = {found.p_value:.2g}" if found.p_value >= 1e-4 else "p < 0.0001"
    tail = f"{shares[ahead]} against {shares[1 - ahead]} right, {gap}; {chance}, {_TESTS[found.test]}."
    if better is None:
        return f"{first} and {second} cannot be told apart on {episodes} of {scenes}: {tail}"
    return f"{first} is better than {second} on {episodes} of {scenes}: {tail}"


def points(value: float) -> str:
    """Format a difference of shares in percentage points, with its sign."""
    return f"{100 * value:+.1f}".replace("-", "−")
