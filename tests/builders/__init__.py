"""Test helpers shared by several folders: builders of sessions, packs and records, and paths of the project."""
