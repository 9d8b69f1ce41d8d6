"""Language models as agents: which exist, how they are asked, and what their errors mean."""
