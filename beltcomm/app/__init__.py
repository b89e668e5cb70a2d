"""The local page on a run (``beltcomm open``): what each of its tabs asks, and the process beside it that works."""
