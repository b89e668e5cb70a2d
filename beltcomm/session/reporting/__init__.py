"""The report of a run: one file per part of the page, each a function from what the run folder holds to a section."""
