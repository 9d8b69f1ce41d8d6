"""The referee: opens episodes for a trainer, and says after the end what each was worth. Holds the keys."""
