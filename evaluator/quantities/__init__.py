"""Numbers with units, as written in answers and in prose."""
