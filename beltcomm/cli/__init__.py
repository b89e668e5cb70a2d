"""The command line: one file per verb; prints, asks, exit codes."""
