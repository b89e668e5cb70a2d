"""A drive under examination: what its checks are given, and how a list of them is run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from beltcomm.drive import KnownMotor
from beltcomm.drive.finding import Finding
from beltcomm.errors import BusError, DriveError, ObjectRefused
from beltcomm_adapters.cia402 import State, state_of
from beltcomm_adapters.link import Link
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.sdo import Objects

#: States in which the power stage is off.
OFF: Final = (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.FAULT)


@dataclass
class Patient:
    """One drive that answers.

    Attributes
    ----------
    identity : Mapping[str, str]
        As read.
    others : tuple of int
        Further nodes that answer.
    bitrate : int or None
        Of the bus, None when it carries any load.
    rtr : bool
        Whether the interface can send remote frames.
    sync_test : bool
        The person allows that PDOs are mapped for a second.
    nmt : int or None
        State byte, None when nobody tells.
    guarded : bool or None
        Whether node guarding was answered, None when it was not tried.
    scaling : Scaling or None
        None until read, or when it cannot be.
    nameplate : KnownMotor or None
        What axis.yaml knows of the motor.
    """

    link: Link
    objects: Objects
    identity: Mapping[str, str]
    profile: Profile
    others: tuple[int, ...] = ()
    bitrate: int | None = None
    rtr: bool = True
    sync_test: bool = False
    nmt: int | None = None
    guarded: bool | None = None
    scaling: Scaling | None = None
    nameplate: KnownMotor | None = None

    @property
    def statusword(self) -> int:
        """6041h now."""
        return self.objects.read_int(0x6041, 0, "uint16")

    @property
    def state(self) -> State:
        """The state of CiA 402 now."""
        return state_of(self.statusword)

    def signal(self, name: str) -> tuple[int, int] | None:
        """(index, subindex) of one of the profile's ``signals``, None where the profile names none.

        Parameters
        ----------
        name : str
            As in the profile.
        """
        entry = self.profile.signals.get(name)
        return None if entry is None else (entry["index"], entry.get("subindex", 0))


class Check(NamedTuple):
    """One check: where its findings belong, what it is called when it fails, and the function."""

    area: str
    name: str
    look: Callable[[Patient], Iterable[Finding]]


def examine(patient: Patient, checks: Iterable[Check]) -> Iterator[Finding]:
    """Run the checks in order; one that the drive does not answer is a finding, and a lost bus ends them.

    Parameters
    ----------
    patient : Patient
        Drive that is asked.
    checks : iterable of Check
        In their order.
    """
    for check in checks:
        try:
            yield from check.look(patient)
        except ObjectRefused as error:
            yield Finding(check.area, check.name, "unknown", f"the drive does not tell: {error}")
        except BusError as error:
            yield Finding(check.area, check.name, "wrong", f"the drive no longer answers: {error}", unreachable=True)
            return
        except DriveError as error:
            text, remedy = error.fault_and_remedy
            yield Finding(check.area, check.name, "wrong", text, remedy)
