"""Proves a variant that no certificate covers before the referee opens it."""

import anyio.to_thread

from evaluator.certify.seed_proofs import SeedProver
from evaluator.errors import RefusedRequest
from evaluator.referee.contract import Variant, WantedEpisode
from evaluator.referee.selection import next_variant
from scenes import find_pack


async def proved_variant(prover: SeedProver, wanted: WantedEpisode, variant: Variant) -> Variant:
    """Return a variant if it is certified, proved, or of a scene without a certificate.

    Otherwise the scene's next seed in the split takes its place, unless the request named the seed.

    Args:
        prover: Proves seeds.
        wanted: The request.
        variant: The variant that it selects.

    Raises:
        RefusedRequest: The variant cannot be proved, and no other may take its place.
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
