"""Paths of the project's files, and of the published prototype if a copy of it is present."""

import os
from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
DOCS = ROOT / "docs"
ORIGINAL = Path(os.environ.get("PHYSMENT_ORIGINAL", ROOT.parent / "shared" / "physment-original"))
"""Folder with packs and logs of the published prototype; tests marked `published` are skipped where it is missing."""
