"""Language models as agents: providers and models, their clients, and the handling of their errors."""
