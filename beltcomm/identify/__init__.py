"""From recordings to parameters: pure functions of arrays and values; nothing here opens a file, a port or a plot."""
