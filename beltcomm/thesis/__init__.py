"""What the design source compares, recomputed: one file per topic with ``compare()`` → values and ``lines(values)`` → words."""
