"""What a model leaves of its records, cut so that a page can show it along every coordinate, and what could explain any part of it."""
