"""Certificate 5: a scene is as hard as its category says; a Hard scene without limits cannot be solved by rote."""

from collections.abc import Iterator, Sequence

from evaluator.answers.engine import is_intervention
from evaluator.certify.driving import drive
from evaluator.certify.records import Check, check
from evaluator.certify.subject import Subject
from evaluator.records.episode import Episode
from scenes import Category, Pack

EASY_INTERVENTIONS, EASY_ITERATIONS, ITERATIONS = 3, 5, 20
"""Greatest number of interventions and of iterations in an Easy scene, and of iterations in any scene."""


async def check_difficulty(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """Check the length of the reference protocol and the number of concepts.

    A Hard scene that states no limits must also force to adapt; what scenes with limits must do instead, certificates
    7 to 9 say.
    """
    category = subject.pack.category
    assert category is not None
    interventions = [_interventions(episode) for episode in episodes]
    iterations = [len(episode.turns) for episode in episodes]
    reasons: list[str] = []
    if category.value.startswith("easy"):
        if max(interventions) > EASY_INTERVENTIONS:
            reasons.append(
                f"the reference intervenes {max(interventions)} times; in an Easy scene at most {EASY_INTERVENTIONS}"
            )
        if max(iterations) > EASY_ITERATIONS:
            reasons.append(
                f"the reference takes {max(iterations)} iterations; in an Easy scene at most {EASY_ITERATIONS}"
            )
    adapts = category.value.startswith("hard") and not subject.pack.predicts
    if adapts and min(interventions) <= EASY_INTERVENTIONS:
        reasons.append(
            f"the reference needs only {min(interventions)} interventions; a Hard scene needs more than"
            f" {EASY_INTERVENTIONS}"
        )
    if max(iterations) > ITERATIONS:
        reasons.append(f"the reference takes {max(iterations)} iterations; the largest budget is {ITERATIONS}")
    reasons += concept_faults(subject.pack)
    called = {exchange.call.tool for episode in episodes for turn in episode.turns for exchange in turn.exchanges}
    reasons += [
        f"requires names {tool}, but the reference never calls it"
        for tool in subject.pack.requires
        if tool not in called
    ]
    figures: dict[str, float | list[str]] = {
        "interventions": max(interventions),
        "iterations": max(iterations),
        "tools": sorted(called - {"answer"}),
    }
    if adapts:
        tried = len(episodes) - 1
        wrong = await _wrong_by_rote(subject, tried)
        figures |= {"wrong_by_rote": wrong, "tried_by_rote": tried}
        if wrong * 2 <= tried:
            reasons.append(
                f"the interventions of seed 0, with the right readings, are wrong on only {wrong} of {tried} other"
                " seeds: a Hard scene must force to adapt"
            )
    return check("difficulty", reasons, **figures)


def concept_faults(pack: Pack) -> Iterator[str]:
    """Yield a sentence if a pack lists too many or too few concepts; open worlds may have any number."""
    if pack.category is None or pack.category is Category.OPEN:
        return
    several = "multi" in pack.category.value or pack.category is Category.CREATE_DELETE_ATTACH
    if (len(pack.concepts) >= 2) != several:
        yield (
            f"{pack.category.value} scenes have {'two or more concepts' if several else 'one concept'};"
            f" this one lists {len(pack.concepts)}"
        )


def _interventions(episode: Episode) -> int:
    calls = (exchange.call for turn in episode.turns for exchange in turn.exchanges)
    return sum(is_intervention(call.tool, call.arguments) for call in calls)


async def _wrong_by_rote(subject: Subject, seeds: int) -> int:
    """Number of seeds on which the interventions of seed 0, with the seed's own readings, give a wrong answer."""
    solve = subject.solution.solve
    assert solve is not None
    first = await drive(subject.session(subject.draw(0)), solve)
    rote = [call for call in first.calls if is_intervention(call.tool, call.arguments)]
    wrong = 0
    for seed in range(1, seeds + 1):
        draw = subject.draw(seed)
        driven = await drive(subject.session(draw), solve, rote)
        wrong += bool(driven.failure) or not subject.agrees(driven.answer, subject.truth(draw))
    return wrong
