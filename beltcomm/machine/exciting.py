"""One open-loop record: watched against its prediction, against its stop, and against the death of the computer at any instant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from beltcomm.drive import Row
from beltcomm.errors import DriveError, Refused, SafetyStop
from beltcomm.excitation import Excitation
from beltcomm.identify.amplitude import Prediction
from beltcomm.machine import delivered, host_loss
from beltcomm.machine.host_loss import guard_times_s
from beltcomm.machine.machine import Envelope, Machine
from beltcomm.machine.prediction_watch import PredictionWatch, units_of
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from beltcomm.simulate.stopping import HostLoss


@dataclass(frozen=True)
class ExcitationContext:
    """Predicted motion of a record, the models that the axis may be, and the death of the host for each."""

    predicted: Prediction
    family: Sequence[Model]
    losses: Callable[[Model], Sequence[HostLoss]]


def run_on_words(machine: Machine, predicted: Prediction, ends_m: float) -> str:
    """Way that the carriage runs on if the computer dies, in words, with the guard time that the record will have.

    Parameters
    ----------
    machine : Machine
    predicted : Prediction
        Of an excitation.
    ends_m : float, m
        Way from the record's place to the nearer end of the travel.
    """
    number = host_loss.chosen(predicted, ends_m)
    return host_loss.words(guard_times_s(machine.drive.capabilities)[number], predicted.run_on_m[number])


def guarded(
    machine: Machine, excitation: Excitation, at: float, envelope: Envelope, context: ExcitationContext
) -> tuple[Envelope, Callable[[Row], None]]:
    """Limits of an excitation around a place, m, with the guard time of its run-on, and the watch of its rows.

    Parameters
    ----------
    machine : Machine
    excitation : Excitation
        That will be sent.
    at : float, m
        Place on the axis.
    envelope : Envelope
        Of the excitation.
    context : ExcitationContext
        Its prediction, and the models that count for the run-on.

    Returns
    -------
    tuple of Envelope and callable
        The watch raises SafetyStop.
    """
    predicted, full = context.predicted, machine.envelope()
    (low, high), ends = envelope.window_m, full.window_m
    number = host_loss.chosen(predicted, min(at - ends[0], ends[1] - at))
    guard_s = guard_times_s(machine.drive.capabilities)[number]
    envelope = replace(envelope, window_m=(low + predicted.stop_m, high - predicted.stop_m), guard_s=guard_s)
    stated, units = machine.axis.motor_side_inertia_kg_m2, units_of(machine.drive.capabilities)
    expected = PredictionWatch(predicted, machine.ratio, stated, units, rigid=machine.axis.rigid)
    dying = host_loss.RunOnWatch(
        ends,
        machine.ratio,
        machine.origin_rad,
        context.family,
        excitation.amplitude_nm,
        lambda model: context.losses(model)[number],
        full.speed_m_s,
    )

    def watch(row: Row) -> None:
        expected(row)
        try:
            dying(row)
        except SafetyStop as stop:
            raise SafetyStop(f"{stop}; or {expected.cause()}", stop.reason) from None

    return envelope, watch


def excite(
    machine: Machine, name: str, excitation: Excitation, at: float, envelope: Envelope, context: ExcitationContext, held_out: bool = False
) -> Recording:
    """Record an excitation around a place, m: a stop at any limit still ends in the envelope, and a run-on before the end of the travel.

    Parameters
    ----------
    machine : Machine
    name : str
        Of the record.
    excitation : Excitation
        That is sent.
    at : float, m
        Place on the axis.
    envelope : Envelope
        Of the excitation.
    context : ExcitationContext
        Its prediction, and the models that count for the run-on.
    held_out : bool
        True for a record that judges.

    Raises
    ------
    DriveError, Refused
        When another torque was delivered than was asked for; the record is withdrawn.
    """
    envelope, watch = guarded(machine, excitation, at, envelope, context)
    note = ExcitationNote(
        kind=excitation.kind,
        amplitude_nm=excitation.amplitude_nm,
        period_samples=excitation.period_samples,
        first_sample=excitation.first_sample,
    )
    sidecar = Sidecar("frf", machine.place_m(at), machine.session_time_s, held_out=held_out, excitation=note)
    recording = machine.record(name, machine.torque_motion(excitation.torque), envelope, sidecar, watch)
    try:
        said = delivered.check(recording)
    except (DriveError, Refused):
        machine.folder.withdraw(name)
        raise
    if said:
        machine.remark(said)
    return recording
