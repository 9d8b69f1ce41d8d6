"""Reports: HTML pages, tables and figures made from scores and records. Computes no scores."""
