"""Variants as task folders of Harbor: written with a solution that was played, and graded from the laboratory's log."""
