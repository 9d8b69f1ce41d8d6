"""Formats a calibration as tables, as a map of takers and scenes, and as an HTML page."""

from collections.abc import Iterator, Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined

from evaluator.records.calibration import LEVELS, Calibration, Standing
from evaluator.report.export import markdown, shown
from evaluator.report.tables import Cell, Table

_COLUMNS = ("right", "of", "logits", "± SE", "infit", "outfit")


def calibration_tables(found: Calibration) -> list[Table]:
    """Return the tables of a calibration."""
    doubtful = [scene for scene in found.scenes if scene.is_doubtful]
    scenes = [[scene.name, scene.rung, *_cells(scene), scene.separation] for scene in found.scenes]
    return [
        Table("abilities", "Abilities", ("agent", *_COLUMNS), [[one.name, *_cells(one)] for one in found.takers], 2),
        Table("pairs", "Neighbours", _PAIR, [_pair(found, place) for place in range(len(found.pairs))], 2, _NOTE),
        Table(
            "doubtful",
            "Scenes that separate negatively",
            ("scene", "separation", "logits", "outfit"),
            [[scene.name, scene.separation, scene.logits, scene.outfit] for scene in doubtful],
            2,
            "Better agents are right less often there, by more than luck at 5 %; of scenes that tell nobody apart, one"
            " in twenty is listed by luck.",
        ),
        Table(
            "effects",
            "What makes a scene hard",
            ("feature", "logits per standard deviation", "± SE"),
            [[one.feature, one.logits, one.se] for one in found.effects],
            2,
            f"The features leave a spread of {found.spreads.scene:.2f} logits between scenes, and"
            f" {found.spreads.variant:.2f} between the seeds of a scene.",
        ),
        Table(
            "information",
            "Information of an episode by rung",
            ("rung", *(f"at {level:+d}" for level in LEVELS)),
            [[rung, *values] for rung, values in found.information.items()],
            3,
            "Of an average scene, about an ability of so many logits. The standard error of an ability is about"
            " 1/√(sum over episodes).",
        ),
        *_generalisability(found),
        Table("difficulties", "Difficulties", ("scene", "rung", *_COLUMNS, "separation"), scenes, 2),
    ]


_PAIR = ("abler", "than", "difference, logits", "± SE", "scenes to tell them apart")
_NOTE = "Each scene with as many seeds and epochs as here; a test at 5 % then finds the difference with 80 % certainty."


def _cells(place: Standing) -> list[Cell]:
    return [place.right, place.answers, place.logits, place.se, place.infit, place.outfit]


def _pair(found: Calibration, place: int) -> list[Cell]:
    pair = found.pairs[place]
    return [pair.better, pair.worse, pair.difference, pair.se, pair.scenes or "over 100000"]


def _generalisability(found: Calibration) -> Iterator[Table]:
    parts = found.components
    if parts is None:
        return
    now = (parts.scenes, parts.seeds, parts.epochs)
    designs = {"as played": now, "twice the scenes": (2 * now[0], *now[1:])}
    designs |= {"twice the seeds": (now[0], 2 * now[1], now[2]), "twice the epochs": (*now[:2], 2 * now[2])}
    yield Table(
        "generalisability",
        "What to add",
        ("design", "scenes", "seeds", "epochs", "smallest difference found, points"),
        [[name, *design, 100 * parts.smallest_difference(*design)] for name, design in designs.items()],
        1,
        f"Of two accuracies, with 80 % certainty at 5 %. Variances: taker × scene {parts.taker_scene:.4f}, taker × seed"
        f" {parts.taker_variant:.4f}, epochs {parts.epoch:.4f}. What was played once cannot be told from what it is"
        " part of, so that seeds or epochs show no gain before there are two.",
    )


def person_item_map(found: Calibration) -> str:
    """Draw a common scale in half logits, largest values on top, with takers on its left and scenes on its right."""

    def step(place: Standing) -> int:
        return round(2 * place.logits)

    steps = [step(place) for place in (*found.takers, *found.scenes)]
    left = {at: ", ".join(one.name for one in found.takers if step(one) == at) for at in steps}
    right = {at: " ".join(str(one.scene) for one in found.scenes if step(one) == at) for at in steps}
    width = max(map(len, left.values()))
    lines = [
        f"{left.get(at, ''):>{width}} | {at / 2:+5.1f} | {right.get(at, '')}".rstrip()
        for at in range(max(steps), min(steps) - 1, -1)
    ]
    return "\n".join([f"{'agents':>{width}} | logit | scenes", *lines])


def calibration_text(found: Calibration) -> str:
    """Format a calibration in Markdown."""
    drawn = f"## Agents and scenes on one scale\n\n```text\n{person_item_map(found)}\n```\n"
    return f"{markdown(calibration_tables(found))}\n{drawn}"


def calibration_page(title: str, found: Calibration) -> str:
    """Format a calibration as an HTML page.

    Args:
        title: Names of the runs.
        found: The calibration.
    """
    environment = Environment(
        loader=PackageLoader("evaluator.calibration"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    low, high = _ends([*found.takers, *found.scenes])
    template = environment.get_template("calibration.html.j2")
    return template.render(title=title, found=found, tables=calibration_tables(found), shown=shown, low=low, high=high)


def _ends(places: Sequence[Standing]) -> tuple[int, int]:
    """Return the ends, in whole logits, of a range that contains all estimates and their 95 % intervals."""
    low = min(place.logits - 1.96 * place.se for place in places)
    high = max(place.logits + 1.96 * place.se for place in places)
    return int(low // 1), int(-(-high // 1))
