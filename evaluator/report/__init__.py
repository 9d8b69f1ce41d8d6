"""From scores and records to pages, tables and figures for people. Computes no scores."""
