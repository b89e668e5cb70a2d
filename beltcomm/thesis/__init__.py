"""Comparisons of the design source, recomputed: one file per topic with ``compare()`` → values and ``lines(values)`` → words."""
