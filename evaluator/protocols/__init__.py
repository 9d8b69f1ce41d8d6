"""How calls are written down: as JSON in prose, or typed by a person."""
