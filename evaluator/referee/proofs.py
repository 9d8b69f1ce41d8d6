"""Checks the seed of a requested variant before the referee opens it, unless a certificate covers the seed."""

import anyio.to_thread

from evaluator.certify.seed_proofs import SeedProver
from evaluator.errors import RefusedRequest
from evaluator.referee.contract import Variant, WantedEpisode
from evaluator.referee.selection import next_variant
from scenes import find_pack


async def proved_variant(prover: SeedProver, wanted: WantedEpisode, variant: Variant) -> Variant:
    """Check the seed of a variant and return the variant to open.

    If the seed fails, the next seed of the scene in the split replaces it, unless the request named the seed. A scene
    without a certificate is not checked.

    Args:
        prover: Checks seeds.
        wanted: The request.
        variant: The variant that it selects.

    Raises:
        RefusedRequest: The seed fails the checks and must not be replaced, or no other seed is left.
    """
    while await anyio.to_thread.run_sync(prover.needs_proof, variant.scene, variant.seed):
        place = variant.scene, variant.seed
        failed = await prover.prove([(find_pack(variant.scene, prover.scenes_dir), variant.seed)])
        if not failed:
            break
        if wanted.seed is not None or variant.index is None:
            raise RefusedRequest(404, f"{failed[place].sentence(variant.scene)}, so it is not opened")
        variant = next_variant(variant)
    return variant
