"""What a run folder holds and what follows from it without a machine."""
