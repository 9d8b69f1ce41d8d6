"""Pages of the documentation that follow from the packs: the list of scenes with pictures, and worked examples."""
