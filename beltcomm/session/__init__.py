"""The sequence on the machine: plan, limits, phases; the only part of the core that moves an axis."""
