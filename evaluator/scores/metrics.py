"""Summarises a run: accuracies, the six dimensions and the Final Score, for the whole run and for groups.

Open worlds are a separate track: they appear in `by_rung`, as `open`, and in no other group.
Every value is given with its number of episodes. `evaluator.scores.grouping` computes the scores of a group from its
episodes. Unscored episodes (infrastructure errors, withdrawn packs) count only in `outcomes`.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple, TypeVar

from pydantic import Field

from evaluator.records.episode import Choice, Grade, NormalisationClass, Outcome, Record, Verdict, is_absent
from evaluator.scores.dimensions import SCORING_VERSION, MedianCost, median_cost
from evaluator.scores.failures.findings import FailureCount, FailureMode, failure_counts
from evaluator.scores.grouping import (
    Condition,
    ScorePoint,
    condition,
    group_scores,
    held_out,
    modality,
    problem_kind,
    quadrant,
    skill,
    skill_interval,
)
from evaluator.scores.scored_episode import (
    AccuracyBounds,
    AppliedErratum,
    EvidenceSummary,
    LawSummary,
    ScoredEpisode,
    accuracy_bounds,
    applied_errata,
    evidence_summary,
    law_summary,
)
from evaluator.statistics.ability import Ability, ability_of
from evaluator.statistics.intervals import Attempts, Interval, IntervalMethod, Proportion, attempts, proportion
from evaluator.statistics.paired import BudgetCurve, Cell, budget_curve

_Name = TypeVar("_Name", str, int)


class GroupSummary(Record):
    """Scores of one group of episodes."""

    n: int
    """Number of episodes."""
    n_scored: int
    """Number of episodes with a verdict. All fields below except `outcomes` are computed from these alone."""
    n_scenes: int
    """Number of scenes of the scored episodes. If a scene has several episodes, scenes are the sampling units of
    intervals."""
    n_correct: int
    """Number of strictly correct episodes."""
    n_withdrawn: int = 0
    """Number of episodes without verdict because their pack has a known fault, which `RunSummary.errata` describes."""
    accuracy_bounds: AccuracyBounds | None = None
    """Bounds of the strict accuracy if the withdrawn episodes counted; None if there are none."""
    strict_accuracy: float | None
    """Share of strictly correct episodes, 0 to 1."""
    strict_interval: Interval | None
    """95 % confidence interval."""
    normalised_accuracy: float | None
    """Share of episodes that normalised grading accepts, 0 to 1."""
    normalised_interval: Interval | None
    """95 % confidence interval."""
    interval_method: IntervalMethod | None
    """Name of the method that computes both intervals; None if no episode is scored."""
    forgiven: dict[NormalisationClass, int]
    """Reason → number of scored episodes that normalised grading accepts and strict grading rejects."""
    skill: float | None = None
    """(strict accuracy - a) / (1 - a), where a is the accuracy of blind guesses on the same scenes and seeds: 0 for a
    blind guess, 1 for a perfect agent."""
    skill_interval: Interval | None = None
    """95 % confidence interval."""
    blind_accuracy: float | None = None
    """Mean probability that a blind guess is right, 0 to 1, computed from the keys."""
    c: float | None
    """Mean graded correctness, 0 to 1."""
    e: float | None
    """Mean efficiency, 0 to 1."""
    g: float | None
    """Pooled grounding: supported numbers divided by all stated numbers; None below 20 stated numbers."""
    g_plus: float | None
    """Pooled grounding in which derived numbers count as supported."""
    n_numbers: int = 0
    """Numbers that the reasoning states: the denominator of `g` and `g_plus`."""
    v: float | None
    """Mean share of valid calls. An episode without an experiment counts 0; None if no episode has one."""
    v_enabled: float | None
    """As `v`, without calls of tools that the scene disables."""
    r: float | None
    """Mean non-repetition. An episode without an experiment or without reasoning counts 0; None if all are such."""
    g_prime: float | None
    """Mean held-out category accuracy over the episodes for which it is defined."""
    step_credit: float | None
    """Mean share of intermediate quantities that are stated correctly with the answer, over the episodes whose scene
    names some. It is not part of FS or FS*."""
    n_defined: dict[str, int]
    """Field name of a dimension → number of scored episodes that define it."""
    final_score: float | None
    """FS of the group, 0 to 100; None if an episode of the group has no G′, because a score without one of its six
    dimensions is not comparable."""
    final_score_of_defined: float | None
    """FS* of the group, 0 to 100, over the dimensions that are not None."""
    gated: float | None = None
    """Mean of C · FS* without G′ over episodes, 0 to 100: the process counts in proportion to correctness."""
    blind_score: float | None = None
    """Expected FS of an agent that guesses blindly without an experiment; None if an episode has no G′."""
    silent_turns: float | None
    """Share of all turns that have no visible reasoning; None without turns."""
    unread_turns: int = 0
    """Number of turns whose reply could not be parsed, so that no call was run."""
    disabled_calls: int
    """Number of calls of tools that the scene disables."""
    experiment_cost: MedianCost
    """Median calls and lab time of an episode."""
    failures: dict[FailureMode, FailureCount]
    """Failure mode → number of scored episodes that show it, and of those that are strictly incorrect."""
    evidence: EvidenceSummary | None = Field(default=None, exclude_if=is_absent)
    """Verdicts on the evidence of the scored episodes; absent if none was measured."""
    laws: LawSummary | None = Field(default=None, exclude_if=is_absent)
    """The laws that the scored episodes stated; absent if their scenes ask for none."""
    outcomes: dict[Outcome, int]
    """Outcome → number of episodes, over all `n` episodes."""


class ConditionCurve(Record):
    """The budget curve of one agent under one prompting and protocol."""

    agent: str
    prompting: str
    protocol: str
    curve: BudgetCurve


class ConditionAttempts(Record):
    """pass@k and pass^k of one agent under one condition."""

    agent: str
    budget: int
    prompting: str
    protocol: str
    attempts: Attempts


class ConditionAbility(Record):
    """The ability of an agent in an adaptive test under one condition."""

    agent: str
    budget: int
    prompting: str
    protocol: str
    estimate: Ability


class RunSummary(Record):
    """Scores of a run, for all episodes and for each grouping that the paper's hypotheses need."""

    format: Literal[2, 3] = 3
    """Version of this record. New fields do not change it; no field is changed or removed within a version. Version 2
    is still read; its dimensions were means over the episodes that define them."""
    scoring_version: int = 1
    """Version of the scoring rules; absent in format 2, where it is 1."""
    overall: GroupSummary
    """All scenes except open worlds."""
    by_rung: dict[str, GroupSummary]
    """`easy`; `hard`, which includes create-delete-attach; `open`, where C is the share of predictions that are right;
    `–` for scenes without a category."""
    by_category: dict[str, GroupSummary]
    by_quadrant: dict[str, GroupSummary]
    """`easy-single`, `easy-multi`, `hard-single`, `hard-multi`, regardless of modality; other categories unchanged."""
    by_modality: dict[str, GroupSummary]
    """`plain`, `creation`, `hidden`, regardless of the quadrant; other categories unchanged."""
    by_problem_type: dict[str, GroupSummary]
    by_problem_kind: dict[str, GroupSummary]
    """`qualitative` (comparison, observation), `quantitative` (calculation, computation), `other`."""
    by_budget: dict[int, GroupSummary]
    by_prompting: dict[str, GroupSummary]
    by_protocol: dict[str, GroupSummary]
    by_agent: dict[str, GroupSummary]
    budget_curves: tuple[ConditionCurve, ...]
    """One curve for each agent, prompting and protocol that was played at several budgets, on the episodes scored at
    all of them."""
    attempts: tuple[ConditionAttempts, ...]
    """One entry for each condition under which every scene was played more than once."""
    abilities: tuple[ConditionAbility, ...] = ()
    """One entry for each agent and condition of an adaptive test."""
    errata: tuple[AppliedErratum, ...] = ()
    """Known faults of the packs that were played, open worlds included."""


class _Row(NamedTuple):
    source: ScoredEpisode
    g_prime: float | None
    blind_g_prime: float | None


def summarise(rows: Sequence[ScoredEpisode]) -> RunSummary:
    """Summarise the episodes of a run."""
    suite = [row for row in rows if not row.is_open]
    table = _table(suite)
    return RunSummary(
        scoring_version=SCORING_VERSION,
        overall=_summary(table),
        by_rung=_grouped([*table, *_table([row for row in rows if row.is_open])], lambda row: row.rung),
        by_category=_grouped(table, lambda row: row.category),
        by_quadrant=_grouped(table, lambda row: quadrant(row.category)),
        by_modality=_grouped(table, lambda row: modality(row.category)),
        by_problem_type=_grouped(table, lambda row: row.problem_type),
        by_problem_kind=_grouped(table, lambda row: problem_kind(row.problem_type)),
        by_budget=_grouped(table, lambda row: row.key.budget),
        by_prompting=_grouped(table, lambda row: row.key.prompting),
        by_protocol=_grouped(table, lambda row: row.key.protocol),
        by_agent=_grouped(table, lambda row: row.key.agent),
        budget_curves=tuple(_budget_curves(suite)),
        attempts=tuple(_attempts(suite)),
        abilities=tuple(_abilities(suite)),
        errata=applied_errata(row.erratum for row in rows),
    )


def _table(rows: Sequence[ScoredEpisode]) -> list[_Row]:
    own = held_out_accuracy(rows)
    blind = held_out((condition(row.key), row.category, row.chance.strict) for row in rows if row.is_scored)
    keys = [(condition(row.key), row.category) for row in rows]
    return [_Row(row, own.get(key), blind.get(key)) for row, key in zip(rows, keys, strict=True)]


def _budget_curves(rows: Iterable[ScoredEpisode]) -> Iterator[ConditionCurve]:
    """Yield accuracy against budget for each agent, prompting and protocol.

    A curve contains only the variants that were scored at every budget of the agent.
    """
    found: defaultdict[tuple[str, str, str], defaultdict[tuple[int, int, int], dict[int, bool]]]
    found = defaultdict(lambda: defaultdict(dict))
    for row in rows:
        if row.is_scored:
            key = row.key
            cells = found[key.agent, key.prompting, key.protocol]
            cells[key.scene, key.seed, key.epoch][key.budget] = row.is_correct
    for (agent, prompting, protocol), cells in sorted(found.items()):
        budgets = sorted({budget for verdicts in cells.values() for budget in verdicts})
        common = [
            Cell(scene, tuple(verdicts[budget] for budget in budgets))
            for (scene, _, _), verdicts in sorted(cells.items())
            if len(verdicts) == len(budgets)
        ]
        if len(budgets) > 1 and common:
            curve = budget_curve(budgets, common)
            yield ConditionCurve(agent=agent, prompting=prompting, protocol=protocol, curve=curve)


def _attempts(rows: Iterable[ScoredEpisode]) -> Iterator[ConditionAttempts]:
    found: defaultdict[Condition, defaultdict[int, list[bool]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        if row.is_scored:
            found[condition(row.key)][row.key.scene].append(row.is_correct)
    for played, verdicts in sorted(found.items()):
        tried = attempts(dict(sorted(verdicts.items())))
        if tried is not None:
            yield ConditionAttempts(**played._asdict(), attempts=tried)


def _abilities(rows: Iterable[ScoredEpisode]) -> Iterator[ConditionAbility]:
    found: defaultdict[Condition, list[tuple[int, int, Choice, bool]]] = defaultdict(list)
    for row in rows:
        if row.is_scored and row.episode.chosen is not None:
            chosen = (row.key.scene, row.key.seed, row.episode.chosen, row.is_correct)
            found[condition(row.key)].append(chosen)
    for played, answers in sorted(found.items()):
        yield ConditionAbility(**played._asdict(), estimate=ability_of(answers))


def held_out_accuracy(rows: Iterable[ScoredEpisode]) -> Mapping[tuple[Condition, str], float]:
    """Return G′ for each condition and category: the mean strict accuracy of the *other* categories.

    Each category has the same weight. Agents, budgets, promptings and protocols are never pooled. A condition with a
    single category has no entry.
    """
    return held_out((condition(row.key), row.category, row.is_correct) for row in rows if row.is_scored)


def _grouped(table: Sequence[_Row], group: Callable[[ScoredEpisode], _Name]) -> dict[_Name, GroupSummary]:
    groups: defaultdict[_Name, list[_Row]] = defaultdict(list)
    for row in table:
        groups[group(row.source)].append(row)
    return {name: _summary(groups[name]) for name in sorted(groups)}


def _summary(table: Sequence[_Row]) -> GroupSummary:
    counted = [row for row in table if row.source.is_scored]
    scored = [row.source for row in counted]
    strict = _proportion(scored, lambda grade: grade.strict)
    normalised = _proportion(scored, lambda grade: grade.normalised)
    scores = group_scores(
        [
            ScorePoint(
                row.source.scores, row.source.chance, row.source.episode.allowance, row.g_prime, row.blind_g_prime
            )
            for row in counted
        ]
    )
    blind = scores.blind_accuracy
    turns = sum(len(row.episode.turns) for row in scored)
    withdrawn = sum(row.source.is_withdrawn for row in table)
    return GroupSummary(
        n=len(table),
        n_scored=len(scored),
        n_scenes=strict.n_scenes if strict else 0,
        n_correct=strict.n_correct if strict else 0,
        n_withdrawn=withdrawn,
        accuracy_bounds=accuracy_bounds(strict.n_correct if strict else 0, len(scored), withdrawn),
        strict_accuracy=strict and strict.share,
        strict_interval=strict and strict.interval,
        normalised_accuracy=normalised and normalised.share,
        normalised_interval=normalised and normalised.interval,
        interval_method=strict and strict.method,
        forgiven={reason: sum(row.grade.normalisation is reason for row in scored) for reason in NormalisationClass},
        **scores._asdict(),
        skill=None if strict is None or blind is None else skill(strict.share, blind),
        skill_interval=None if strict is None or blind is None else skill_interval(strict.interval, blind),
        silent_turns=sum(row.scores.silent_turns for row in scored) / turns if turns else None,
        unread_turns=sum(row.scores.unread_turns for row in scored),
        disabled_calls=sum(row.scores.disabled_calls for row in scored),
        experiment_cost=median_cost([row.experiment_cost for row in scored]),
        failures=failure_counts((row.grade, row.failures) for row in scored),
        evidence=evidence_summary(row.measured for row in scored if row.measured),
        laws=law_summary(row.stated for row in scored if row.stated),
        outcomes=dict(sorted(Counter(row.source.episode.outcome for row in table).items())),
    )


def _proportion(scored: Sequence[ScoredEpisode], verdict: Callable[[Grade], Verdict]) -> Proportion | None:
    rows = [(row.key.scene, verdict(row.grade) is Verdict.CORRECT) for row in scored]
    return proportion(rows) if rows else None
