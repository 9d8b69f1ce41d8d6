"""What several test folders build alike: sessions, packs, records, and where the project's files are."""
