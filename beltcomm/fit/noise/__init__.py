"""Noise of torque and angle: its level and colour, what a linear law makes of it on its way to the residual, and whitening."""
