"""Stops out of a closed position loop: asked for, the drive ramps down at once; when the host is lost, as soon as it notices.

Until then the setpoint stands still. Setpoint, speed and torque that were sent along stay as they were last. The acceleration that the
drive feeds forward, the difference of its speeds, ends with them, so that the torque which accelerated the axis falls away at once, and
the position controller pulls back harder with each millisecond. A following error beyond 6065h for longer than 6066h ends that, or the
guard time; then the drive stops along its ramp, from the speed that its loop was last asked for, which the filter of its reference holds.
Carriage side, SI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array
from beltcomm.control import Cascade, begin_ramp, measured_speed, new_state, reset_state
from beltcomm.simulate.loop import LoopDrive, close_loop, waiting_torque
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.simulate.stopping import REST_S


@dataclass(frozen=True)
class StopReaction:
    """Reaction of a drive that ends in a stop along its ramp: to a stop that is asked for, or to setpoints that stand still.

    Attributes
    ----------
    window_rad, lasting_s : float, motor shaft
        Following error, and how long it must last, that is a fault of the drive; an infinite one is none.
    guard_s : float
        After which silence is noticed at the latest; 0 for a stop that is asked for.
    deceleration_m_s2 : float
        Of the stop that follows, carriage.
    """

    window_rad: float
    lasting_s: float
    guard_s: float
    deceleration_m_s2: float


@dataclass(frozen=True)
class StopOutOfMove:
    """The axis from the last setpoint to rest.

    Attributes
    ----------
    way_m : float
        Carriage, from where it was; infinite where it ran off what its model describes.
    low_m, high_m : float
        Between which the carriage stays meanwhile; infinite likewise.
    belt_force_n : float
        Largest, N; infinite likewise.
    """

    way_m: float
    low_m: float
    high_m: float
    belt_force_n: float

    def __or__(self, other: StopOutOfMove) -> StopOutOfMove:
        """The worse of both in each."""
        return StopOutOfMove(
            max(self.way_m, other.way_m),
            min(self.low_m, other.low_m),
            max(self.high_m, other.high_m),
            max(self.belt_force_n, other.belt_force_n),
        )


#: None, and one that ran off what its model describes.
NO_STOP, OFF_THE_MODEL = StopOutOfMove(0.0, math.inf, -math.inf, 0.0), StopOutOfMove(math.inf, -math.inf, math.inf, math.inf)


@dataclass(frozen=True)
class References:
    """References of a position loop, (n,), one per run of it.

    Attributes
    ----------
    position_rad, speed_rad_s, added_nm : ndarray (n,), motor shaft
    """

    position_rad: Array
    speed_rad_s: Array
    added_nm: Array

    def lost_at(self, at: int, runs: int) -> tuple[Array, Array, Array]:
        """Those up to run ``at``; then the last stand still for ``runs`` runs."""

        def then_at_rest(values: Array, last: float) -> Array:
            return np.concatenate((values[:at], np.full(runs, last)))

        last = at - 1
        return (
            then_at_rest(self.position_rad, float(self.position_rad[last])),
            then_at_rest(self.speed_rad_s, float(self.speed_rad_s[last])),
            then_at_rest(self.added_nm, float(self.added_nm[last])),
        )


def predict_stop_out_of_move(
    resting: SimulatedPlant, cascade: Cascade, references: References, at: int, drive: LoopDrive, reaction: StopReaction
) -> StopOutOfMove:
    """The axis from the last setpoint to rest.

    Parameters
    ----------
    resting : SimulatedPlant
        Where the axis sets out; it stays there.
    at : int
        Run of the loop with which the setpoints end, at least 1.

    Raises
    ------
    Refused
        When the carriage leaves what the model describes.
    """
    guard = math.ceil(reaction.guard_s / drive.period_s)
    noticed = guard
    if math.isfinite(reaction.window_rad):
        run = close_loop(resting.copied(), cascade, drive, "position", *references.lost_at(at, guard))
        late = np.abs(references.position_rad[at - 1] - references.position_rad[0] - run.position_rad[at:]) > reaction.window_rad
        beyond = np.flatnonzero(late)
        if len(beyond):
            noticed = min(guard, int(beyond[0]) + math.ceil(reaction.lasting_s / drive.period_s) + 1)
    plant, state, lost = resting.copied(), new_state(), references.lost_at(at, noticed)
    start_rad = float(references.position_rad[0])
    reset_state(state, start_rad)
    waiting = waiting_torque(cascade, drive)
    run = close_loop(plant, cascade, drive, "position", *lost, state=state, waiting_nm=waiting)
    asked = cascade.kpp_1_s * (float(lost[0][-1]) - start_rad - plant.position_rad) + cascade.feedforward.velocity * float(lost[1][-1])
    speed = min(max(measured_speed(state), min(asked, 0.0)), max(asked, 0.0))
    slower = reaction.deceleration_m_s2 / resting.model["transmission.ratio"] * drive.period_s
    runs = math.ceil(abs(speed) / slower) + round(REST_S / drive.period_s)
    ramp = math.copysign(1.0, speed) * np.maximum(abs(speed) - slower * np.arange(1, runs + 1), 0.0)
    place, none = np.full(runs, start_rad + plant.position_rad), np.zeros(runs)
    begin_ramp(state, speed)
    rest = close_loop(plant, cascade, drive, "velocity", place, ramp, none, acceleration_rad_s2=none, state=state, waiting_nm=waiting)
    places = resting.start_m + np.concatenate((run.cart_m[at:], rest.cart_m))
    force = float(np.concatenate((run.belt_force_n[at:], rest.belt_force_n)).max())
    return StopOutOfMove(float(np.abs(places - places[0]).max()), float(places.min()), float(places.max()), force)
