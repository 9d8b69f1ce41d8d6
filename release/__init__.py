"""How a checkout becomes files that others install: built, checked, tried out, versioned. Not part of the wheel."""
