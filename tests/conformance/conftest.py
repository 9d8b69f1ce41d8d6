"""Makes the modules of `make conformance` importable; as a program they are imported from its own folder."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
