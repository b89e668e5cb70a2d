"""Which records are made, in which order, over which way: values only, read by commissioning, plans from files and words."""
