"""Timing side channel: checks that all seeds of a pack have equal numbers of laws, bodies, joints and other parts.

An agent can measure how long a step takes. Each law and each part costs time in every step, so their numbers must be
the same at every seed. Measured with two bodies and one law, where a time step of the Euler integrator takes 7 µs: a
second law costs 4 µs, a row of the constraint solver (dry friction, an equality) 0.3 µs, a fluid around the bodies
0.24 µs, a body with a joint 0.1 µs, a tendon 0.07 µs. Stiffness and damping cost less than 0.1 µs. The Runge-Kutta
integrator takes four times as long for all of them.
"""

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

import numpy as np

from evaluator.certify import compiled_model
from physment_mcp.errors import Unstable
from physment_mcp.world import World
from scenes import Pack, PackFiles, draw_knobs, drawn_mjcf

SEEDS = 20
"""Number of seeds whose models are compared."""
_DRIVEN_S, _PIECE_S = 2.0, 0.1
"""Duration of the test of laws in motion, and of its pieces [s]. The push is reversed after every second piece."""
_LAWS = "laws"


def models_of(files: PackFiles, pack: Pack) -> list[str]:
    """The models of a pack at the seeds that are compared.

    Raises:
        PackError: The values of a model cannot be sampled.
    """
    return [drawn_mjcf(files, pack, draw_knobs(files, pack, seed), canonical=seed == 0) for seed in range(SEEDS)]


def model_faults(files: PackFiles, pack: Pack) -> Iterator[str]:
    """Yield a sentence if the number of parts or laws depends on the seed, or a disabled law has a non-finite value.

    Raises:
        PackError: The values of a model cannot be sampled.
    """
    models = models_of(files, pack)
    yield from unequal_laws(models)
    yield from unequal_parts(models)
    if pack.limits is not None:
        bodies = [f"object_{entry.object_id}" for entry in pack.objects.values()]
        yield from absent_laws_without_value(models, bodies, pack.limits.force or 0.0, pack.limits.torque or 0.0)


def unequal_laws(models: Sequence[str]) -> Iterator[str]:
    """Yield a sentence if the models of a pack, from seed 0 on, have different numbers of laws."""
    yield from _unequal(_LAWS, [len(_laws(mjcf)) for mjcf in models])


def unequal_parts(models: Sequence[str]) -> Iterator[str]:
    """Yield a sentence for each kind of part whose number differs between the models, from seed 0 on.

    Besides elements, it counts rows of the constraint solver at the start, such as those of joints and tendons with a
    `frictionloss` above 0, and bodies in a fluid with a density, because these also cost time.

    Raises:
        ValueError: A model does not compile.
    """
    numbers = [compiled_model.numbers_of_parts(mjcf) for mjcf in models]
    for kind in numbers[0]:
        yield from _unequal(kind, [found[kind] for found in numbers])


def _unequal(kind: str, numbers: Sequence[int]) -> Iterator[str]:
    for seed, number in enumerate(numbers):
        if number != numbers[0]:
            yield (
                f"the number of {kind} is {numbers[0]} at seed 0 and {number} at seed {seed}, so the time of a step"
                " tells of the draw: keep what is absent in the model, and let it do nothing, as with a stiffness of 0"
            )
            return


def absent_laws_without_value(
    models: Sequence[str], bodies: Sequence[str], force: float, torque: float
) -> Iterator[str]:
    """Yield a sentence for the first seed at which a disabled law makes a step fail.

    Such a law has the factor 0, but a non-finite value still fails the step. The test pushes all bodies back and forth.

    Args:
        models: The models, from seed 0 on.
        bodies: Names of the bodies that an agent can push.
        force: Largest force of the agent [N].
        torque: Largest torque of the agent [N·m].
    """
    for seed, mjcf in enumerate(models):
        reduced = _without_absent(mjcf)
        loads = (force, torque)
        if reduced is not None and not _moves(mjcf, bodies, *loads) and _moves(reduced, bodies, *loads):
            yield (
                f"at seed {seed} a law that is not present has no finite value in motion, which ends the step:"
                " write it so that it has one in every state, for example with max(r, 0.001) in place of r"
            )
            return


def _laws(mjcf: str) -> list[dict[str, object]]:
    text = ET.fromstring(mjcf).find(f"custom/text[@name='{_LAWS}']")  # noqa: S314 - the user's pack
    return [] if text is None else json.loads(text.get("data") or "[]")


def _without_absent(mjcf: str) -> str | None:
    """Return the model without its laws of factor 0; None if it has no such laws."""
    laws = _laws(mjcf)
    acting = [law for law in laws if law.get("factor") != 0]
    if len(acting) == len(laws):
        return None
    root = ET.fromstring(mjcf)  # noqa: S314 - the user's pack
    (text,) = root.findall(f"custom/text[@name='{_LAWS}']")
    text.set("data", json.dumps(acting))
    return ET.tostring(root, encoding="unicode")


def _moves(mjcf: str, bodies: Sequence[str], force: float, torque: float) -> bool:
    """Return whether the world can be stepped while all bodies are pushed back and forth along (1, 1, 1)."""
    world = World(mjcf)
    along = np.ones(3) / np.sqrt(3)
    movable = [body for body in bodies if world.is_movable(body)]
    try:
        for piece in range(round(_DRIVEN_S / _PIECE_S)):
            sign = 1.0 if piece % 4 < 2 else -1.0
            for body in movable:
                world.push(body, sign * force * along, sign * torque * along)
            world.step(world.whole_steps(_PIECE_S))
    except Unstable:
        return False
    return True
