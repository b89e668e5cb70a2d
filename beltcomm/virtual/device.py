"""The virtual drive: a CANopen node with a servo inside and a machine behind it."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from beltcomm.errors import UsageError
from beltcomm.plant import IDEAL, Instruments, Plant
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.cia402 import DriveState
from beltcomm.virtual.dictionary import NonVolatile, ObjectDictionary, SdoAbort, Value
from beltcomm.virtual.emcy import Code, ErrorRegister
from beltcomm.virtual.faults import Faults
from beltcomm.virtual.foreign import profile_named
from beltcomm.virtual.loops import Loops
from beltcomm.virtual.nmt import OPERATIONAL, PRE_OPERATIONAL, RESET_NODE, STOPPED, Nmt
from beltcomm.virtual.pdo import PdoSet
from beltcomm.virtual.profiles import with_gain_units
from beltcomm.virtual.sdo import SdoServer, abort_of, begun_transfer
from beltcomm.virtual.servo import Servo
from beltcomm.virtual.stage import EMMS_AS_70, Encoder, Nameplate, PowerStage

_SYNC, _EMCY, _SDO_ANSWER, _SDO_REQUEST, _NODE_CONTROL = 0x80, 0x80, 0x580, 0x600, 0x700
#: Objects that tell the cycle of the loops, us.
_CYCLE_TIMES = ((0x2101, 1), *((0x6510, sub) for sub in range(0xB0, 0xB4)))
_SAVE, _LOAD = int.from_bytes(b"save", "little"), int.from_bytes(b"load", "little")


class VirtualDrive:
    """A servo drive on a :class:`LockstepBus`.  It is told nothing but CAN frames and the motion of its machine.

    Parameters
    ----------
    plant : Plant
        The machine; stepped by this drive alone.
    profile : str
        "reference" or "cmmp-as" (docs/reference-drive.md), or another maker's drive (:mod:`beltcomm.virtual.foreign`).
    node_id : int
        1 to 127.
    seed : int
        Of the torque noise.
    counts_per_rev : int
        Encoder.
    setpoint_delay_s : float, s
        >= 0, from the tick in which a torque setpoint is decided to the torque.
    torque_noise_nm : float, N m
        Standard deviation of 6077h.
    motor : Nameplate
        Its nameplate.
    zero_rad : float
        Motor angle where the encoder counts 0.
    referenced : bool
        An absolute encoder knows that zero from power-on.
    end_switches_rad : tuple[float, float] or None
        Motor angles of the lower and upper end switch; None: none are wired.
    nonvolatile : NonVolatile or None
        What 1010h saves; pass it to the next drive to play a power cycle.
    fault_bits : int
        Bits 3-0 of the statusword in the state Fault: 08h (CiA 402) or 0Fh.
    faults : Faults or None
        What goes wrong.
    brake : tuple[float, float]
        Torque of a holding brake, N m, 0 for none, and s in which it opens or closes.
    gain_units : tuple[float, float, float]
        As :func:`beltcomm.virtual.profiles.with_gain_units` takes them: what the host must find out.
    hardware : str
        What 1009h says.
    instruments : Instruments
        What else lies between setpoint, torque, 6077h and 6064h. answers_at_once : by SDO, however slow the maker's drive is: where
        SYNCs make the time, none passes while the host waits.

    Raises
    ------
    UsageError
        For an unknown profile, a node ID or a delay out of range.
    """

    def __init__(
        self,
        bus: LockstepBus,
        plant: Plant,
        profile: str = "reference",
        *,
        node_id: int = 1,
        seed: int = 0,
        counts_per_rev: int = 65536,
        setpoint_delay_s: float = 1e-3,
        torque_noise_nm: float = 6e-3,
        motor: Nameplate = EMMS_AS_70,
        zero_rad: float = 0.0,
        referenced: bool = False,
        end_switches_rad: tuple[float, float] | None = None,
        nonvolatile: NonVolatile | None = None,
        fault_bits: int = 0x08,
        faults: Faults | None = None,
        brake: tuple[float, float] = (0.0, 0.0),
        gain_units: tuple[float, float, float] = (1.0, 1.0, 1.0),
        hardware: str = "virtual",
        instruments: Instruments = IDEAL,
    ) -> None:
        if not 1 <= node_id <= 127:
            raise UsageError(f"the node ID {node_id} is not a CANopen one; choose 1 to 127")
        if setpoint_delay_s < 0.0:
            raise UsageError(f"the setpoint delay is {setpoint_delay_s} s; give 0 or more")
        self.faults = faults if faults is not None else Faults()
        self._bus = bus
        self._node_id = node_id
        self._stored: NonVolatile = {} if nonvolatile is None else nonvolatile
        kind = with_gain_units(profile_named(profile), *gain_units)
        rows = kind.rows(node_id, motor, counts_per_rev)
        told: dict[tuple[int, int], Value] = {(0x1009, 0): hardware, **dict.fromkeys(_CYCLE_TIMES, round(1e6 * bus.tick_s))}
        here = (replace(row, default=told.get((row.index, row.subindex), row.default)) for row in rows)
        self._dictionary = ObjectDictionary(here)
        for second, first in kind.aliases:
            self._dictionary.alias(*second, self._dictionary.entry(*first))
        self._dictionary.load(self._stored)
        self._errors = ErrorRegister(self._dictionary, self._send_emcy)
        loops = self._loops = Loops(self._dictionary, kind, motor, counts_per_rev, self.faults, bus.tick_s)
        instruments = kind.instruments if instruments == IDEAL else instruments
        stage = PowerStage(plant, motor, setpoint_delay_s, torque_noise_nm, seed, self.faults, brake, instruments, bus.tick_s)
        encoder = Encoder(plant, counts_per_rev, zero_rad, self.faults, instruments)
        self._servo = Servo(
            self._dictionary,
            kind,
            loops,
            stage,
            encoder,
            plant,
            self._errors,
            self.faults,
            end_switches_rad,
            referenced,
            fault_bits,
        )
        self._sdo = SdoServer(self._dictionary)
        self._pdos = PdoSet(self._dictionary, self._send_pdo, self._errors.report, replace(kind.pdos, ticks_per_ms=loops.ticks_per_ms))
        self._nmt = Nmt(
            self._dictionary,
            node_id,
            self._send_node_control,
            self._nmt_changed,
            self._reset,
            lambda: self._servo.communication_lost(Code.LIFE_GUARD),
            loops.ticks_per_ms,
            kind.after_loss,
        )
        entry, has = self._dictionary.entry, self._dictionary.has
        self._silent = False
        self._answer_ticks = round(kind.sdo_delay_ms * loops.ticks_per_ms)
        self._answers: deque[tuple[int, bytes]] = deque()
        self.answers_at_once = False
        self._counter_overflow = entry(0x1019) if has(0x1019) else None
        if self._counter_overflow is not None:
            self._counter_overflow.check = self._check_overflow
        self._syncs = 0
        self._sync_owed = False
        self._sent_pdos = 0
        self._transfers = 0
        entry(0x1005).check = self._check_sync_id
        entry(0x1010, 1).check = self._save
        entry(0x1011, 1).check = self._restore_defaults
        self._servo.restart()
        self._pdos.configure()
        bus.attach(self)

    @property
    def state(self) -> DriveState:
        """CiA 402 state, for tests that look inside; the host reads 6041h."""
        return self._servo.machine.state

    @property
    def objects(self) -> ObjectDictionary:
        """The object dictionary, for a port beside the bus."""
        return self._dictionary

    def reset_node(self) -> None:
        """Start anew, as at power-on."""
        self._nmt.command(bytes((RESET_NODE, self._node_id)))

    @property
    def powered(self) -> bool:
        """True if the motor carries torque."""
        return self._servo.machine.powered

    @property
    def sync_ticks(self) -> float:
        """Ticks that a SYNC stands for where it makes the time: the period 60C2h while PDOs are exchanged, else a millisecond."""
        if self._nmt.state != OPERATIONAL:
            return self._loops.ticks_per_ms
        return self._loops.interpolation_ticks

    def receive(self, identifier: int, data: bytes, remote: bool) -> None:
        """One frame from the bus."""
        if self._silent:
            return
        if remote:
            if self.faults.remote_frames_blocked:
                return
            if identifier == _NODE_CONTROL + self._node_id:
                self._nmt.guard_request()
            elif identifier in self._pdos.asked:
                self._pdos.asked[identifier]()
            return
        receiver = self._pdos.receivers.get(identifier)
        if receiver is not None:
            receiver(data)
        elif identifier == _SYNC:
            self._on_sync(len(data))
        elif identifier == _SDO_REQUEST + self._node_id:
            if self._nmt.state in (PRE_OPERATIONAL, OPERATIONAL):
                for answer in self._sdo_answer(data):
                    if self._answer_ticks and not self.answers_at_once:
                        self._answers.append((self._bus.tick + self._answer_ticks, answer))
                    else:
                        self._send(_SDO_ANSWER + self._node_id, answer)
        elif identifier == 0:
            self._nmt.command(data)
        elif _NODE_CONTROL < identifier <= _NODE_CONTROL + 127 and len(data) == 1:
            self._nmt.heard(identifier - _NODE_CONTROL)

    def begin_tick(self, tick: int) -> None:
        """t_k: latch, supervise, then what is due by time."""
        silent_from_s = self.faults.silent_from_s
        self._silent = silent_from_s is not None and tick / self._bus.ticks_per_second >= silent_from_s
        reset_at_s = self.faults.reset_at_s
        if reset_at_s is not None and tick / self._bus.ticks_per_second >= reset_at_s:
            self.faults.reset_at_s = None
            self.reset_node()
        self._servo.latch(tick)
        self._nmt.tick(tick)
        while self._answers and self._answers[0][0] <= tick:
            self._send(_SDO_ANSWER + self._node_id, self._answers.popleft()[1])
        if self._sync_owed:
            self._sync_owed = False
            self._pdos.on_sync()
        self._pdos.on_tick(tick)

    def finish_tick(self) -> None:
        """Loops of tick k with what is in force now, then the machine moves to t_k+1."""
        self._servo.run()

    def _sdo_answer(self, data: bytes) -> list[bytes]:
        """The SDO server's answer, or what its faults make of it."""
        faults = self.faults
        if not (faults.sdo_abort or faults.sdo_silent or faults.misread):
            return self._sdo.answer(data)
        begins = begun_transfer(data)
        if begins is None:
            return self._sdo.answer(data)
        self._transfers += 1
        if self._transfers in faults.sdo_silent:
            return []
        if self._transfers in faults.sdo_abort:
            return [abort_of(*begins[:2], faults.sdo_abort[self._transfers])]
        answers = self._sdo.answer(data)
        index, subindex, reads = begins
        if not reads or not answers or (index, subindex) not in faults.misread:
            return answers
        return [answers[0][:4] + faults.misread[index, subindex].to_bytes(4, "little")]

    def _on_sync(self, length: int) -> None:
        if self._counter_overflow is not None and length != (self._counter_overflow.value > 0):
            self._errors.report(Code.SYNC_LENGTH)
        self._syncs += 1
        if self._syncs in self.faults.ignore_sync:
            return
        if self._syncs in self.faults.late_sync:
            self._sync_owed = True
            return
        self._pdos.on_sync()

    def _send(self, identifier: int, data: bytes) -> None:
        if not self._silent:
            self._bus.transmit(self, identifier, data)

    def _send_pdo(self, identifier: int, data: bytes) -> None:
        self._sent_pdos += 1
        if not self._silent and self._sent_pdos not in self.faults.drop_tpdo:
            self._bus.transmit(self, identifier, data)

    def _send_emcy(self, data: bytes) -> None:
        if self._nmt.state in (PRE_OPERATIONAL, OPERATIONAL):
            self._send(_EMCY + self._node_id, data)

    def _send_node_control(self, data: bytes) -> None:
        self._send(_NODE_CONTROL + self._node_id, data)

    def _nmt_changed(self, old: int, new: int) -> None:
        if OPERATIONAL in (old, new):
            self._pdos.set_operational(new == OPERATIONAL)
        if new == STOPPED and self._servo.machine.powered:
            self._servo.communication_lost(Code.COMMUNICATION)

    def _reset(self, node: bool) -> None:
        """Reset of the node, or of its communication only: then a motor under power is braked into fault."""
        self._sdo.reset()
        self._answers.clear()
        self._sync_owed = False
        if node:
            self._dictionary.load(self._stored)
            self._errors.restart()
            self._servo.restart()
        else:
            if self._servo.machine.powered:
                self._servo.communication_lost(Code.COMMUNICATION)
            self._dictionary.load(self._stored, communication_only=True)
        self._pdos.configure()

    @staticmethod
    def _check_sync_id(value: int) -> int:
        if value & 0x7FFFFFFF != _SYNC:
            raise SdoAbort(SdoAbort.BAD_VALUE)
        return value

    def _check_overflow(self, value: int) -> int:
        if value == 1:
            raise SdoAbort(SdoAbort.BAD_VALUE)
        if self._dictionary.has(0x1006) and self._dictionary.entry(0x1006).value:
            raise SdoAbort(SdoAbort.WRONG_STATE)
        return value

    def _save(self, signature: int) -> int:
        self._check_signature(signature, _SAVE)
        self._dictionary.save(self._stored)
        return 1

    def _restore_defaults(self, signature: int) -> int:
        """Defaults become valid with the next reset or power-on (CiA 301, 7.5.2.14)."""
        self._check_signature(signature, _LOAD)
        self._stored.clear()
        return 1

    def _check_signature(self, given: int, wanted: int) -> None:
        if given != wanted:
            raise SdoAbort(SdoAbort.NOT_STORED)
        if self._dictionary.stage_on:
            raise SdoAbort(SdoAbort.WRONG_STATE)
