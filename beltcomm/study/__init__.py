"""A population of axes: what its members are, what one design does on each of them, what follows for all; values to values."""
