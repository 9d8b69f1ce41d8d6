"""What is known of a scene before anybody plays it: features from its pack and its certificates."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from evaluator.calibration.model import Array
from evaluator.certify.records import SceneCertificate, read_certificates
from scenes import Pack, default_folder, find_pack, read_pack

FEATURES = (
    "hard",
    "several concepts",
    "hidden bodies",
    "something to create, delete or attach",
    "laws",
    "noise",
    "possible structures",
    "interventions of the reference",
    "lab time of the reference",
)
"""Names of the features; the last three are logarithms."""


def features_of(scenes: Sequence[int], scenes_dir: Path | None = None) -> Array:
    """The features of scenes, a row for each, standardised; a feature in which they do not differ is 0.

    Args:
        scenes: Their ids.
        scenes_dir: Folder of scene packs; None for the suite.

    Raises:
        PackError: A pack is missing or malformed.
    """
    stored = read_certificates(scenes_dir or default_folder())
    certificates = {one.scene: one for one in stored.scenes} if stored else {}
    packs = [read_pack(find_pack(scene, scenes_dir)) for scene in scenes]
    table = np.array([_row(pack, certificates.get(scene)) for scene, pack in zip(scenes, packs, strict=True)])
    spread = table.std(axis=0)
    return (table - table.mean(axis=0)) / np.where(spread > 0, spread, 1.0)


def _row(pack: Pack, certificate: SceneCertificate | None) -> list[float]:
    category = pack.category.value if pack.category else ""
    noise = pack.instruments.noise if pack.instruments else None
    structures = _structures(_figure(certificate, "structure", "structures"))
    return [
        float(category.startswith("hard")),
        float("multi" in category),
        float(sum(allowed.hidden for allowed in pack.object_permissions.values())),
        float("creation" in category or category == "create-delete-attach"),
        float(len(pack.laws)),
        float(bool(noise)),
        math.log(structures),
        _logarithm(_figure(certificate, "difficulty", "interventions")),
        _logarithm(_figure(certificate, "instrument", "lab_time_s")),
    ]


def _figure(certificate: SceneCertificate | None, check: str, name: str) -> object:
    """A figure of a certificate; None if there is none."""
    checks = certificate.checks if certificate else ()
    return next((one.figures.get(name) for one in checks if one.name == check), None)


def _structures(labels: object) -> int:
    """How many structures a scene may have; 1 where its certificate names none."""
    return len(cast("list[str]", labels)) if isinstance(labels, list) and labels else 1


def _logarithm(value: object) -> float:
    return math.log1p(value) if isinstance(value, int | float) else 0.0
