"""Results in words, small tables and mappings for programs."""
