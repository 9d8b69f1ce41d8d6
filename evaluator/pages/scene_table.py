"""Generates `scenes.md`, the table of all scenes, and the documentation page of each scene.

The pages contain public properties, certificates and how to play a scene. Answers, knobs, ranges, reasoning and hidden
objects are omitted. `Listing` names the public fields explicitly, so a private field that packs gain stays private.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Self

from evaluator.certify.records import SceneCertificate
from evaluator.report.export import escaped, markdown_table
from scenes import AnswerKind, AnswerSpec, Category, LabLimits, Pack, PackFiles, PublicPack


@dataclass(frozen=True, slots=True)
class Steps:
    """Length of the reference protocol: minimum and maximum over several seeds.

    The length at a single seed could reveal the answer, because a protocol may continue until it has found the answer.
    """

    iterations: tuple[int, int]
    interventions: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Listing:
    """The public properties of a scene."""

    scene: int
    name: str
    category: Category | None
    concepts: tuple[str, ...]
    answer: str
    """The form of the answer, in words."""
    in_sight: int
    """Number of objects that an agent knows from the start, without hidden objects."""
    steps: Steps | None
    """None if the reference protocol does not run."""

    @classmethod
    def of(cls, files: PackFiles, pack: Pack, steps: Steps | None) -> Self:
        """Collect the public properties of a pack."""
        return cls(
            scene=files.scene_id,
            name=pack.metadata.scene_name,
            category=pack.category,
            concepts=pack.concepts,
            answer=answer_form(pack.answer_spec),
            in_sight=sum(not pack.permissions_of(key).hidden for key in pack.objects),
            steps=steps,
        )


def answer_form(spec: AnswerSpec | None) -> str:
    """Describe the form of an answer: its kind, options or units, and tolerance; empty if the pack does not say.

    The number of requested numbers follows from their labels or units alone, because the answer itself is private.
    """
    if spec is None:
        return ""
    if spec.options:
        return f"one of {len(spec.options)}: {', '.join(spec.options)}"
    if spec.kind is AnswerKind.TEXT:
        return "a sentence"
    if spec.kind is AnswerKind.NUMBERS:
        return f"{_numbers(spec)}; {_tolerance(spec)}"
    kind = f"a formula in {', '.join(spec.variables)}" if spec.kind is AnswerKind.FORMULA else "a number"
    unit = "" if spec.unit is None else f" ({_unit(spec.unit)})"
    return f"{kind}{unit}; {_tolerance(spec)}"


def _numbers(spec: AnswerSpec) -> str:
    """Describe a list of numbers: their count, labels and units, as far as the pack states them."""
    count = len(spec.labels) or (len(spec.unit) if isinstance(spec.unit, tuple) else 0)
    units = spec.unit if isinstance(spec.unit, tuple) else (spec.unit,) * max(count, 1)
    named = [_unit(unit) for unit in units if unit is not None]
    if spec.labels:
        pairs = zip_longest(spec.labels, named[:count], fillvalue="")
        return f"{count} numbers: {', '.join(f'{label} ({unit})' if unit else label for label, unit in pairs)}"
    return " ".join([f"{count or 'several'} numbers", *([f"({', '.join(named)})"] if named else [])])


def _unit(unit: str | tuple[str, ...]) -> str:
    return "no unit" if unit == "1" else ", ".join((unit,) if isinstance(unit, str) else unit)


def _tolerance(spec: AnswerSpec) -> str:
    unit = f" {spec.unit}" if isinstance(spec.unit, str) and spec.unit != "1" else ""
    parts = [f"{100 * spec.rel_tol:g} %"] if spec.rel_tol else []
    parts += [f"{spec.abs_tol:g}{unit}"] if spec.abs_tol else []
    return f"within {' plus '.join(parts) or 'rounding'}"


KINDS: Mapping[str, tuple[int, ...]] = {
    "motion": (13, 21, 59),
    "friction": (14, 57, 64, 103),
    "free fall": (7, 12, 51, 25),
    "horizontal projectile": (54,),
    "elastic collision": (15, 73, 18, 62),
    "inclined plane": (11, 53, 17, 8),
}
"""UTOPIA's six kinds of scenes → the most similar scenes of this suite, most similar first."""

SCENES_PAGE = Path("reference", "scenes.md")
"""Path of the page in the documentation."""
PICTURES = "scenes"
"""Folder of the pictures and of the pages of single scenes, next to the page."""
SMALL = "small"
"""Folder of the thumbnails, inside that of the pictures."""

_TITLES = ("picture", "scene", "name", "concepts", "answer", "iterations, interventions", "objects")

_HEAD = """\
# The scenes

Made from the packs by `make pages`; do not edit. It shows nothing that a pack hides from an agent: no answers, no
hidden values or their ranges, no hidden objects, no methods.

- **Picture**: the laboratory at the start, seen from the side of −y, with x to the right and z up. It shows only what
  is the same for every seed: no hidden object, and no part whose position, size or colour depends on the seed. If
  nothing is left, it is a schematic of what an agent may read. Each leads to a larger picture with axes and a scale;
  the scale holds at the distance of the middle of the picture.
- **Name**: leads to the page of the scene, with its task and limits.
- **Answer**: its options; or its numbers, each with its unit, and how close is close enough.
- **Iterations, interventions**: the number of turns of the reference protocol, and of calls in them that change the
  world; minimum and maximum over several seeds, because the length at one seed could reveal the answer.
- **Objects**: the number of objects that an agent knows from the start.
"""

_KINDS_HEAD = """\
## Scene kinds of UTOPIA

UTOPIA (Liu et al., *Mind's Eye: Grounded Language Model Reasoning through Simulation*, ICLR 2023) asks about six kinds
of scenes. The scenes below are about the same physics, most similar first. They are not copies: here the deciding
quantity is not given but has to be measured.
"""


def scenes_page(listings: Sequence[Listing], pictured: Collection[int]) -> str:
    """Generate the page.

    Args:
        listings: The scenes, ordered by id.
        pictured: Ids of the scenes that have a picture.
    """
    used = {listing.category for listing in listings}
    parts = [_HEAD]
    for category in (category for category in (*Category, None) if category in used):
        rows = [_row(listing, listing.scene in pictured) for listing in listings if listing.category is category]
        parts.append(f"## {category.value if category else 'without category'}\n\n{markdown_table(_TITLES, rows)}\n")
    kinds = _kinds({listing.scene: listing.name for listing in listings})
    return "\n".join([*parts, *([kinds] if kinds else [])]).rstrip() + "\n"


def _row(listing: Listing, pictured: bool) -> tuple[str, ...]:
    return (
        _picture(listing.scene) if pictured else "no picture drawn",
        f'<a id="scene-{listing.scene}"></a>{listing.scene}',
        f"[{escaped(listing.name)}]({PICTURES}/{page_name(listing.scene)})",
        escaped(", ".join(listing.concepts)),
        escaped(listing.answer),
        f"{span(listing.steps.iterations)}, {span(listing.steps.interventions)}" if listing.steps else "–",
        str(listing.in_sight),
    )


def span(ends: tuple[int, int]) -> str:
    """Format a minimum and a maximum, as one number if they are equal."""
    return "–".join(map(str, sorted(set(ends))))


def page_name(scene: int | str) -> str:
    """Return the file name of the page of a scene.

    Args:
        scene: Id of the scene, or a pattern for it, which gives a pattern of file names.
    """
    return f"scene{scene}.md"


def _picture(scene: int) -> str:
    small = f'<img src="{PICTURES}/{SMALL}/scene{scene}.png" width="160" alt="Scene {scene} at its start">'
    return f"[{small}]({PICTURES}/scene{scene}.png)"


def _kinds(names: Mapping[int, str]) -> str:
    rows = [
        (kind, "; ".join(f"[{scene}](#scene-{scene}) {escaped(names[scene])}" for scene in found))
        for kind, scenes in KINDS.items()
        if (found := [scene for scene in scenes if scene in names])
    ]
    return f"{_KINDS_HEAD}\n{markdown_table(('kind', 'scenes'), rows)}" if rows else ""


def scene_page(
    listing: Listing,
    public: PublicPack,
    *,
    pictured: bool,
    certificate: SceneCertificate | None,
    engine: str,
    example: bool,
    difficulty: str = "",
) -> str:
    """Generate the page of a scene.

    Args:
        listing: The public properties of the scene.
        public: The public half of its pack.
        pictured: Whether there is a picture of it.
        certificate: Its certificate; None if the pack was changed since, or never certified.
        engine: Version of MuJoCo for which the certificate holds.
        example: Whether the page of worked examples shows a run of it.
        difficulty: Sentences about its calibrated difficulty; empty if it has none.
    """
    number, name = listing.scene, escaped(listing.name)
    picture = f'<img src="scene{number}.png" width="800" alt="Scene {number} at its start">' if pictured else ""
    limits = "".join(f"- {limit}\n" for limit in _limits(public.limits, public.disabled_tools))
    parts = (
        f"# {number} {name}",
        "Made from the pack by `make pages`; do not edit. It shows nothing that a pack hides from an agent.",
        picture,
        f"**Task.** {escaped(public.task)}",
        f"**Answer.** {escaped(listing.answer) or 'not described'}",
        markdown_table(("object", "name", "may be read", "may be acted on"), _objects(public)),
        f"Limits:\n\n{limits}".rstrip() if limits else "No limits but those of every laboratory.",
        "\n".join(f"- {fact}" for fact in _facts(listing, certificate, engine, difficulty)),
        f"```sh\nphysment-eval play {number} --web      # solve it yourself\n"
        f"physment-eval scenes show {number}     # the whole opening prompt\n"
        f"physment-mcp config claude-desktop --scene {number}\n```",
        "[All scenes](../scenes.md) · [what certificates say](../../how-to/contribute-a-scene.md)"
        + (
            " · [a worked example](../../explanation/worked-examples.md), which discloses its method" if example else ""
        ),
    )
    return "\n\n".join(part for part in parts if part) + "\n"


def _objects(public: PublicPack) -> list[tuple[str, ...]]:
    return [
        (
            escaped(item.object_id),
            escaped(item.name),
            ", ".join(item.permissions.readable) or "nothing",
            "yes" if item.permissions.actuate else "no, sealed",
        )
        for item in public.objects
        if not item.permissions.hidden
    ]


def _limits(limits: LabLimits | None, disabled: Sequence[str]) -> list[str]:
    found: list[str] = []
    if limits is not None:
        named = (
            (limits.calls, "calls, without `answer`"),
            (limits.lab_time, "s of simulated time"),
            (limits.force, "N of force on an object"),
            (limits.torque, "N·m of torque on an object"),
            (limits.created_mass, "kg of created objects"),
        )
        found += [
            f"at most {value:g} {words}" if value else f"no {words.partition(' of ')[2]}"
            for value, words in named
            if value is not None
        ]
    if disabled:
        found.append(f"tools that are disabled: {', '.join(f'`{tool}`' for tool in sorted(disabled))}")
    return found


def _facts(listing: Listing, certificate: SceneCertificate | None, engine: str, difficulty: str) -> list[str]:
    category = listing.category.value if listing.category else "none"
    facts = [f"Category: {category}. Concepts: {escaped(', '.join(listing.concepts)) or 'none named'}."]
    if listing.steps:
        facts.append(
            f"Length: the reference protocol takes {span(listing.steps.iterations)} iterations and"
            f" {span(listing.steps.interventions)} interventions."
        )
    if difficulty:
        facts.append(f"[Difficulty](../../explanation/validity.md#how-hard-a-scene-is): {difficulty}")
    if certificate is None:
        facts.append("Certificates: none that holds for this pack.")
    else:
        passed = sum(check.passed for check in certificate.checks)
        facts.append(
            f"Certificates: {passed} of {len(certificate.checks)} checks passed on {certificate.seeds} seeds, on MuJoCo"
            f" {engine}."
        )
    return facts
