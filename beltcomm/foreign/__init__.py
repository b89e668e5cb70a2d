"""Measurements from elsewhere: foreign tables become recordings of a run folder, the originals kept."""
