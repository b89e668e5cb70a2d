"""Incremental encoders: edges of the two channels, the state machine that counts them, and velocity from them (section 6.1).

``edges`` makes edges from a motion, ``quadrature`` counts them, ``estimators`` turns them into velocity, ``kernel`` holds the compiled
steps of both, ``formulas`` says how exact they are.
Lengths are in metres here; for a rotary encoder put angles in rad in their place, as the source does.
"""
