"""Makes the modules of `make conformance` importable: they are a program, which finds them beside itself."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
