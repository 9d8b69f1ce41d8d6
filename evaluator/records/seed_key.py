"""Held-back seeds: a keyed hash gives the seeds, so that whoever lacks the key can neither know nor prepare for them.

Records hold the number of a variant (0, 1, 2, …) in the place of its seed, and a commitment to the key. The key turns
the number into the seed where a session is opened and where an answer key is computed, and nowhere else.
"""

import hashlib
import hmac
import re
from collections.abc import Callable
from dataclasses import dataclass, field

SeedOf = Callable[[int, int], int]
"""Scene and recorded seed → the seed that the variant is drawn from."""

_DIGITS = 64
_PURPOSE = b"physment held-back seeds 1: "
"""Makes commitment and seeds differ from other uses of the same key."""


def seed_as_recorded(scene: int, seed: int) -> int:
    """The `SeedOf` of every run that is not held back."""
    del scene
    return seed


@dataclass(frozen=True, slots=True)
class SeedKey:
    """The secret of a held-back split."""

    secret: bytes = field(repr=False)

    @classmethod
    def parse(cls, text: str) -> "SeedKey":
        """Read the content of a key file.

        Raises:
            ValueError: It is not 64 hexadecimal digits. Fewer could be found by trying.
        """
        if not re.fullmatch(rf"[0-9a-fA-F]{{{_DIGITS}}}", text.strip()):
            raise ValueError(f"it must hold {_DIGITS} hexadecimal digits and nothing else")
        return cls(bytes.fromhex(text.strip()))

    def seed(self, scene: int, number: int) -> int:
        """The seed of a variant, from 1 to 2^63: HMAC-SHA256 of the scene and the number of the variant."""
        digest = hmac.digest(self.secret, _PURPOSE + f"{scene}:{number}".encode(), "sha256")
        return (int.from_bytes(digest[:8], "big") >> 1) + 1

    @property
    def commitment(self) -> str:
        """What binds a publisher to the key without disclosing it: SHA-256 of a fixed text and the key.

        The same key gives the same commitment, so that runs on the same held-back seeds are known to be comparable.
        A random salt would add nothing: 256 random bits cannot be found by trying.
        """
        return hashlib.sha256(_PURPOSE + self.secret).hexdigest()
