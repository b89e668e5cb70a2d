"""Incremental encoders: edges of the two channels, the state machine that counts them, and velocity from them (section 6.1).

``quadrature`` counts edges, ``edges`` makes them from a motion, ``estimators`` turns them into velocity, ``formulas`` says how exactly.
Lengths are in metres here; for a rotary encoder put angles in rad in their place, as the source does.
"""
