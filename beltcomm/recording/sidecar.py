"""The sidecar of a recording: what was done while it was made (``recordings/NAME.yaml``)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from beltcomm.configfiles import did_you_mean, read_yaml
from beltcomm.errors import DataError
from beltcomm.given import EXCITATION_KINDS, EXPERIMENTS
from beltcomm.quantities import unit_of

#: Likeness from which on an unknown key is called misspelt: foreign sidecars hold many keys of their own.
MISSPELT = 0.9


@dataclass(frozen=True)
class ExcitationNote:
    """The excitation of an ``frf`` record.

    Attributes
    ----------
    kind : str
        One of EXCITATION_KINDS.
    amplitude_nm : float or None
        N m (N for side "load"), largest absolute torque; None when not known.
    period_samples : int or None
        Samples of one period; None when it does not repeat.
    first_sample : int
        Where the first period begins.
    period_starts : tuple of int or None
        First samples of the periods that count, where others lie between them; None: all behind first_sample.
    amplitude_rad_s : float or None
        Largest change of the speed setpoint, where that is what was excited.
    base_speed_m_s : float or None
        At which the carriage travelled; None when it stood.
    """

    kind: str
    amplitude_nm: float | None = None
    period_samples: int | None = None
    first_sample: int = 0
    period_starts: tuple[int, ...] | None = None
    amplitude_rad_s: float | None = None
    base_speed_m_s: float | None = None


@dataclass(frozen=True)
class Sidecar:
    """Circumstances of a record.  None means not known.

    Attributes
    ----------
    experiment : str
        One of EXPERIMENTS.
    start_position_m : float or None, m
        Carriage position at the first sample.
    session_time_s : float or None, s
        Start of the record on the session's clock.
    closed_loop : bool
        A controller was active.
    held_out : bool
        Never used to fit, only to judge.
    payload_kg : float or None, kg
        What was mounted.
    controller : dict of str to Any
        The known controller.
    source : str
        Free text.
    finished : bool
        False while the record is being made, and for ever when that was broken off.
    extra : dict of str to Any
        Keys that mean nothing here, kept as they are.
    payload_inertia_kg_m2 : float or None, kg m²
        The same of a load that turns, about its own axis.
    load : str
        Name of what was mounted: where nobody knows what it weighs, the fit finds out.
    position_integrated : bool
        The position is the integral of a recorded speed, which a drive filters.

    Raises
    ------
    DataError
        For an experiment or a number that cannot be.
    """

    experiment: str = "free"
    start_position_m: float | None = None
    session_time_s: float | None = None
    closed_loop: bool = False
    held_out: bool = False
    payload_kg: float | None = None
    excitation: ExcitationNote | None = None
    controller: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    accepted: str = ""
    finished: bool = True
    extra: Mapping[str, Any] = field(default_factory=dict)
    payload_inertia_kg_m2: float | None = None
    load: str = ""
    position_integrated: bool = False

    def __post_init__(self) -> None:
        _check_choice("experiment", self.experiment, EXPERIMENTS)
        for key, unit in (("payload_kg", "kg"), ("payload_inertia_kg_m2", "kg m²")):
            if (value := getattr(self, key)) is not None and value < 0.0:
                raise DataError(f"{key} is {value:g} {unit}; it must not be negative")
        if self.excitation is None:
            return
        _check_choice("excitation.kind", self.excitation.kind, EXCITATION_KINDS)
        lowest = {"amplitude_nm": 0.0, "period_samples": 4, "first_sample": 0}
        for key, low in lowest.items():
            value = getattr(self.excitation, key)
            if value is not None and value < low:
                raise DataError(f"excitation.{key} is {value:g}; it must be at least {low:g}")

    @property
    def moving(self) -> bool:
        """True if the carriage travelled while it was excited: then the record stands for no single place."""
        return self.excitation is not None and bool(self.excitation.base_speed_m_s)

    def to_dict(self) -> dict[str, Any]:
        """The keys that say something, in the order of the file."""
        data = {item.name: getattr(self, item.name) for item in fields(self) if item.name not in {"excitation", "extra"}}
        if self.excitation is not None:
            note = {item.name: getattr(self.excitation, item.name) for item in fields(self.excitation)}
            data["excitation"] = {key: list(v) if isinstance(v, tuple) else v for key, v in note.items() if v is not None}
        for usual in ("finished", "position_integrated"):  # the contract knows no such keys: most records need none
            if data[usual] is (usual == "finished"):
                del data[usual]
        known = {key: value for key, value in data.items() if value is not None and value != {} and value != ""}
        if self.experiment != "free" and self.start_position_m is None:
            known["start_position_m"] = None  # what an experiment does not know of its place, it says
        return known | dict(self.extra)


def load_sidecar(path: Path) -> tuple[Sidecar, tuple[str, ...]]:
    """Read a sidecar.

    Parameters
    ----------
    path : Path
        YAML file.

    Returns
    -------
    tuple of Sidecar and tuple of str
        The sidecar, and sentences on keys that look misspelt.

    Raises
    ------
    DataError
        Naming file and key, for a file that is no YAML mapping or a value that cannot be.
    """
    try:
        return _sidecar_from_dict(read_yaml(path, DataError))
    except DataError as error:
        raise error if str(path) in str(error) else DataError(f"{path}: {error}") from error


def _sidecar_from_dict(data: Mapping[str, Any]) -> tuple[Sidecar, tuple[str, ...]]:
    """Sidecar from a mapping, and sentences on keys that look misspelt; errors as of :func:`load_sidecar`."""
    names = [item.name for item in fields(Sidecar) if item.name != "extra"]
    read: dict[str, Any] = {}
    extra: dict[str, Any] = {}
    remarks = []
    for key, value in data.items():
        if key not in names:
            extra[key] = value
            hint = did_you_mean(key.replace("-", "_"), [name for name in names if name not in data], MISSPELT)
            if hint:
                remarks.append(f"the sidecar's key {key} means nothing here{hint}")
        elif value is None:
            continue
        elif key == "excitation":
            read[key] = _excitation(value)
        elif key == "controller":
            read[key] = _mapping(key, value)
        else:
            read[key] = _typed(key, value)
    return Sidecar(**read, extra=extra), tuple(remarks)


def _excitation(value: Any) -> ExcitationNote | None:
    note = _mapping("excitation", value)
    if not note:
        return None
    if note.get("kind") is None:
        raise DataError(f"excitation.kind is missing; it is one of {', '.join(EXCITATION_KINDS)}")
    # what else a recorder notes about its excitation (excited lines, seed) means nothing here
    names = {item.name for item in fields(ExcitationNote)}
    return ExcitationNote(**{key: _typed(f"excitation.{key}", note[key]) for key in note if key in names and note[key] is not None})


def _typed(key: str, value: Any) -> Any:
    """The value in the type its key has; raises DataError for another one."""
    name = key.rpartition(".")[2]
    if name == "period_starts" and isinstance(value, (list, tuple)):
        return tuple(_typed(key, item) for item in value)
    if name in {"experiment", "source", "accepted", "kind", "load"}:
        return str(value)
    if name in {"closed_loop", "held_out", "finished", "position_integrated"}:
        if not isinstance(value, bool):
            raise DataError(f"{key} is {value!r}; write true or false")
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        unit = unit_of(name)
        raise DataError(f"{key} is {value!r}; give a number{unit and f' in {unit}'}")
    if name in {"period_samples", "first_sample", "period_starts"}:
        if not float(value).is_integer():
            raise DataError(f"{key} is {value!r}; give a whole number of samples")
        return int(value)
    return float(value)


def _mapping(key: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise DataError(f"{key} is {value!r}; it must hold names and values")
    return value


def _check_choice(key: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise DataError(f"{key} is {value!r}{did_you_mean(value, known)}; it is one of {', '.join(known)}")
