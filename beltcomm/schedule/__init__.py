"""Schedule of records, in order and with their paths: values only, read by commissioning, plans from files and words."""
