"""What a picture of a scene may show: visible parts that look the same for every seed.

The certificates prove that the key depends on the seed, so a picture that does not depend on the seed cannot reveal the
key. Hence an object whose position or size is withheld may be drawn if no seed changes it. Withholding only keeps tools
from measuring it later; the task states its start position, or the position does not matter.
"""

# MuJoCo ships no type stubs.
# pyright: reportAttributeAccessIssue=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportUnknownParameterType=false, reportUnknownVariableType=false

import mujoco
import numpy as np
from numpy.typing import NDArray

from evaluator.certify.compiled_model import started
from physment_mcp.world.pictures.drawing import Visible
from physment_mcp.world.pictures.looks import SHAPES, colour, look
from scenes import Pack, PackFiles, draw_knobs, drawn_mjcf

_SEEDS = 24
"""Number of seeds compared. A fair choice of two values stays undetected with a chance of 1 in 8 million."""


def visible_parts(files: PackFiles, pack: Pack) -> Visible:
    """The parts of a pack that a picture may show.

    Raises:
        PackError: Its hidden values cannot be drawn.
        ValueError: Its model does not compile.
    """
    texts = [drawn_mjcf(files, pack, draw_knobs(files, pack, seed), canonical=seed == 0) for seed in range(_SEEDS)]
    (model, data), *others = [started(text) for text in dict.fromkeys(texts)]
    unseen = _unseen_bodies(model, pack)
    geoms = [
        geom
        for geom in range(model.ngeom)
        if mujoco.mjtGeom(model.geom_type[geom]) in SHAPES
        and int(model.geom_bodyid[geom]) not in unseen
        and colour(model, geom)[3] > 0
        and all(np.array_equal(look(model, data, geom), look(*other, geom)) for other in others)
    ]
    tendons = [
        tendon
        for tendon in range(model.ntendon)
        if model.tendon_rgba[tendon][3] > 0
        and _may_show(model, tendon, unseen)
        and all(np.array_equal(_tendon(model, data, tendon), _tendon(*other, tendon)) for other in others)
    ]
    return Visible(tuple(geoms), tuple(tendons))


def _unseen_bodies(model: mujoco.MjModel, pack: Pack) -> set[int]:
    """Hidden bodies and all bodies attached to them."""
    names = {f"object_{listed.object_id}" for key, listed in pack.objects.items() if pack.permissions_of(key).hidden}
    unseen: set[int] = set()
    for body in range(1, model.nbody):
        if model.body(body).name in names or int(model.body_parentid[body]) in unseen:
            unseen.add(body)
    return unseen


def _may_show(model: mujoco.MjModel, tendon: int, unseen: set[int]) -> bool:
    """Whether a tendon is spatial and touches no hidden body."""
    first = int(model.tendon_adr[tendon])
    for wrap in range(first, first + int(model.tendon_num[tendon])):
        kind, index = mujoco.mjtWrap(model.wrap_type[wrap]), int(model.wrap_objid[wrap])
        if kind == mujoco.mjtWrap.mjWRAP_SITE:
            body = int(model.site_bodyid[index])
        elif kind in {mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER}:
            body = int(model.geom_bodyid[index])
        else:
            return False
        if body in unseen:
            return False
    return True


def _tendon(model: mujoco.MjModel, data: mujoco.MjData, tendon: int) -> NDArray[np.float64]:
    """All that determines how a tendon looks: its path, width, colour, and its range, which sets the sag when slack."""
    first, count = int(data.ten_wrapadr[tendon]), int(data.ten_wrapnum[tendon])
    path = data.wrap_xpos.reshape(-1, 3)[first : first + count].ravel()
    sag = (model.tendon_range[tendon], model.tendon_width[tendon : tendon + 1], model.tendon_rgba[tendon])
    return np.round(np.concatenate((path, *sag), dtype=np.float64), 9)
