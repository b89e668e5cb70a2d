"""Places in the parameter vector and in the state vector of the compiled kernel.

All effects stand side by side in one vector; a healthy machine has zeros where an effect would be.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Bristle-like elements of the frictional belt, and sines of the random drift.
SLIDERS: Final = 4
DRIFT_SINES: Final = 6

# Bodies, transmission, viscous friction.
(J, M, LEVER, VISCOUS, DRAG, ME, M2) = range(7)
# Belt: two strands or three spans; idler bearing; lengths where the spans follow the carriage.
(TOPOLOGY, K1, K2, K3, D1, D2, D3, IDLER_DRAG, SPANS_MOVE, EA, DA, LENGTH1, LENGTH2, LENGTH3, LENGTH_SHARE, MIDDLE) = range(7, 23)
# Loose clamp, slackening spans.
(GAP, GAP_SOFT, PRELOAD, SLACK_SHARE, SLACK_SOFT) = range(23, 28)
# Motor-side friction: LuGre bristle with level by speed, place, direction.
(COULOMB, BRISTLE, MICRO, MICRO_SPEED, ASYMMETRY) = range(28, 33)
(STRIBECK, STRIBECK_SPEED, STRIBECK_EXPONENT, STRIBECK_SHAPE) = range(33, 37)
(TIGHT, TIGHT_PLACE, TIGHT_WIDTH, TIGHT_FLANK) = range(37, 41)
(COULOMB_CART, BRISTLE_CART) = range(41, 43)
(WARM, WARM_TIME, WARM_EXPONENT, WARM_SHAPE) = range(43, 47)
# Forces on the carriage.
(GRAVITY, AIR, AIR_EXPONENT, CABLE, CABLE_PLACE, CABLE_LENGTH) = range(47, 53)
# Ripples.
(COG, COG_ORDER, COG_PHASE, COG_SECOND, COG_SECOND_ORDER, COG_SECOND_PHASE) = range(53, 59)
(TOOTH, TOOTH_ORDER, TOOTH_PHASE, TOOTH_WOBBLE, TOOTH_WOBBLE_PHASE) = range(59, 64)
(RIPPLE, RIPPLE_ORDER, RIPPLE_PHASE, RIPPLE_FADE) = range(64, 68)
(RUNOUT, RUNOUT_PHASE, RUNOUT_OVAL, RUNOUT_OVAL_PHASE) = range(68, 72)
(DISC, DISC_PHASE, DISC_OVAL, DISC_OVAL_PHASE) = range(72, 76)
# Second mass on the carriage.
(K_PAYLOAD, D_PAYLOAD, HARDENING) = range(76, 79)
# From the reported torque to the torque at the shaft.
(SATURATION_LAW, SATURATION, SATURATION_KNEE, DEAD_TIME, LAG, LAG_SECOND) = range(79, 85)
# Outside the catalogue.
SLIDER_STIFFNESS = 85
SLIDER_FORCE = SLIDER_STIFFNESS + SLIDERS
DRIFT = SLIDER_FORCE + SLIDERS
DRIFT_RATE = DRIFT + DRIFT_SINES
DRIFT_PHASE = DRIFT_RATE + DRIFT_SINES
_next = DRIFT_PHASE + DRIFT_SINES
(GREASE, GREASE_PLACE, GREASE_LENGTH) = range(_next, _next + 3)
(CUBIC, CUBIC_PLACE, HYSTERESIS, HYSTERESIS_LENGTH) = range(_next + 3, _next + 7)
(TORQUE_STEP, DEAD_BAND) = range(_next + 7, _next + 9)
(LOOSE, K_IMPACT, LOSS_IMPACT, D_LOOSE) = range(_next + 9, _next + 13)
(RAIL, RAIL_PITCH, RAIL_PHASE) = range(_next + 13, _next + 16)
(SUPPLY, SUPPLY_SECOND, SUPPLY_RATE, SUPPLY_PHASE) = range(_next + 16, _next + 20)
(K_CREEP, CREEP_TIME) = range(_next + 20, _next + 22)
(AGEING, AGEING_LENGTH, AGEING_TIME) = range(_next + 22, _next + 25)
(CODE_PERIOD, CODE_WIDTH, CODE_PLACE) = range(_next + 25, _next + 28)
# Interpolation of a sin/cos encoder.
(LINES, LINE, LINE_PHASE, LINE_SECOND, LINE_SECOND_PHASE, LINE_THIRD, LINE_THIRD_PHASE) = range(_next + 28, _next + 35)
#: Turns of the pulley per turn of the motor.
PULLEY_TURNS = _next + 35
PARAMETERS: Final = _next + 36

#: Kinds of belt: two strands side by side; idler with mass; idler without mass but with a bearing.
TWO_STRANDS, HEAVY_IDLER, LIGHT_IDLER = range(3)
#: Shapes of the Stribeck bump, of the warm-up, of the saturation.
EXPONENTIAL, RATIONAL, SECH = range(3)
STRETCHED, HYPERBOLIC = range(2)
NO_SATURATION, TANH, ARCTAN, KNEE = range(4)

# State: coordinates and speeds of motor, carriage, idler, second mass; creep of the belt; then what has memory.
(ANGLE, SPEED, CART, CART_SPEED, IDLER, IDLER_SPEED, PAYLOAD, PAYLOAD_SPEED, CREEP) = range(9)
(Z_MOTOR, Z_CART, Z_CABLE, AGE, LAG_1, LAG_2, TIME) = range(9, 16)
Z_SLIDER = 16
STATES: Final = Z_SLIDER + SLIDERS
