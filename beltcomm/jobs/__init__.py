"""One file per verb: what a function of the interface does from its arguments to its result."""
