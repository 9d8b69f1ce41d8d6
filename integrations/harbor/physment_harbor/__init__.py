"""Task folders of Harbor: variants with a played solution, graded from the laboratory's log."""
