"""Numbers and records → pages that people read. Does no arithmetic of its own."""
