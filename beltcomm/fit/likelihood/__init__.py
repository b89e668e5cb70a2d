"""Block-robust likelihood of a model as a function of its free parameters: Jacobian, minimum, and its neighbourhood."""
