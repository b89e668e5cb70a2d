"""The compiler of laws: from the effects of a model to machine code, and what such code is made of."""
