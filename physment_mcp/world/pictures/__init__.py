"""Pictures of what may be seen."""
