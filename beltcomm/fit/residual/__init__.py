"""Residual torque of a recording in segments: the measured motion backwards through a model, its usable samples, observer and bias."""
