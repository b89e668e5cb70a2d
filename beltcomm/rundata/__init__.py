"""Contents of a run folder, and results that follow from it without a machine."""
