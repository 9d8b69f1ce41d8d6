"""Numbers with units, written or spoken."""
