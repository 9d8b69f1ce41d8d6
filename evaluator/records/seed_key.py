"""Held-back seeds: a keyed hash derives the seeds, so that they are unknown without the key.

Records hold the number of a variant (0, 1, 2, …) in place of its seed, and a commitment to the key. The seed is derived
from the number and the key only where a session is opened and where an answer key is computed.
"""

import hashlib
import hmac
import re
from collections.abc import Callable
from dataclasses import dataclass, field

SeedOf = Callable[[int, int], int]
"""Function of a scene id and a recorded seed that returns the real seed of the variant."""

_DIGITS = 64
_PURPOSE = b"physment held-back seeds 1: "
"""Prefix that separates commitment and seeds from other uses of the same key (domain separation)."""


def seed_as_recorded(scene: int, seed: int) -> int:
    """The `SeedOf` of runs whose seeds are not held back: returns the recorded seed."""
    del scene
    return seed


@dataclass(frozen=True, slots=True)
class SeedKey:
    """The secret of a held-back split."""

    secret: bytes = field(repr=False)

    @classmethod
    def parse(cls, text: str) -> "SeedKey":
        """Parse the content of a key file.

        Raises:
            ValueError: The text is not 64 hexadecimal digits. A shorter key could be found by brute force.
        """
        if not re.fullmatch(rf"[0-9a-fA-F]{{{_DIGITS}}}", text.strip()):
            raise ValueError(f"it must hold {_DIGITS} hexadecimal digits and nothing else")
        return cls(bytes.fromhex(text.strip()))

    def seed(self, scene: int, number: int) -> int:
        """Return the seed of a variant, from 1 to 2^63: HMAC-SHA256 of the scene and the number of the variant."""
        digest = hmac.digest(self.secret, _PURPOSE + f"{scene}:{number}".encode(), "sha256")
        return (int.from_bytes(digest[:8], "big") >> 1) + 1

    @property
    def commitment(self) -> str:
        """Return a commitment to the key that does not disclose it: SHA-256 of a fixed prefix and the key.

        Equal keys give equal commitments, so runs on the same held-back seeds can be recognised as comparable. No salt
        is needed, because a key of 256 random bits cannot be found by brute force.
        """
        return hashlib.sha256(_PURPOSE + self.secret).hexdigest()
