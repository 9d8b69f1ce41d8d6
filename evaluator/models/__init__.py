"""Language models: which there are and where, how they are asked, and what goes wrong. Knows no episode."""
