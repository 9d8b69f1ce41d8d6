"""Generates the documentation page of one scene: task, public properties, certificate, and how to play it.

Reads only the public half of a pack, and no files.
"""

from collections.abc import Sequence

from evaluator.certify.records import SceneCertificate
from evaluator.pages.scene_table import Listing, span
from evaluator.report.export import escaped, markdown_table
from scenes import LabLimits, Permissions, PublicPack

_READ = {
    "geom_type": "shape",
    "geom_size": "size",
    "geom_radius": "radius",
    "geom_density": "density",
    "body_mass": "mass",
    "body_pos": "position",
    "body_quat": "orientation",
    "angle": "angle",
    "velocity": "velocity",
    "spin": "spin",
}
"""Permission → name of the attribute that it allows to read."""


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
            ", ".join(_readable(item.permissions)) or "nothing",
            "yes" if item.permissions.actuate else "no, sealed",
        )
        for item in public.objects
        if not item.permissions.hidden
    ]


def _readable(may: Permissions) -> list[str]:
    return [word for field, word in _READ.items() if getattr(may, field) is True]


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
