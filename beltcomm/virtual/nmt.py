"""Network management: states, boot-up, heartbeat in and out, node guarding and life guarding (CiA 301, 7.2.8)."""

from __future__ import annotations

from collections.abc import Callable

from beltcomm.virtual.dictionary import ObjectDictionary

BOOTING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
_START, _STOP, _ENTER_PRE_OPERATIONAL, RESET_NODE, _RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
_STATE_AFTER = {_START: OPERATIONAL, _STOP: STOPPED, _ENTER_PRE_OPERATIONAL: PRE_OPERATIONAL}

#: From a reset to the boot-up message.
BOOT_MS = 50
#: 1029h:1, what a node becomes that was operational when it lost its master.
_AFTER_LOSS = {0: PRE_OPERATIONAL, 2: STOPPED}


class Nmt:
    """NMT slave of one node; it boots in its first tick.  Times in ticks, ``ticks_per_ms`` each millisecond.

    Parameters
    ----------
    send : callable
        Puts data under 700h + node ID on the bus. state_changed(old, new) : called on every change of state. reset(node) : the master
        resets the node (True) or its communication.
    master_lost : callable
        Guarding or heartbeat ran out.
    after_loss : int
        In place of 1029h:1 where the drive has none.
    """

    def __init__(
        self,
        dictionary: ObjectDictionary,
        node_id: int,
        send: Callable[[bytes], None],
        state_changed: Callable[[int, int], None],
        reset: Callable[[bool], None],
        master_lost: Callable[[], None],
        ticks_per_ms: float = 1.0,
        after_loss: int = 0,
    ) -> None:
        self.state = BOOTING
        self._per_ms, self._after_loss = ticks_per_ms, after_loss
        self._node_id = node_id
        self._send = send
        self._state_changed = state_changed
        self._reset = reset
        self._master_lost = master_lost
        self._producer_ms = dictionary.entry(0x1017)
        self._consumer = dictionary.entry(0x1016, 1)
        behaviour = dictionary.entry(0x1029, 1) if dictionary.has(0x1029, 1) else None
        self._behaviour = None if behaviour is None or behaviour.row.access == "none" else behaviour
        self._guard_time_ms = dictionary.entry(0x100C)
        self._life_time_factor = dictionary.entry(0x100D)
        self._producer_ms.changed = self._restart_producer
        self._consumer.changed = self._forget_heartbeat
        self._guard_time_ms.changed = self._life_time_factor.changed = self._forget_guarding
        self._tick = 0
        self._boot_left = 0
        self._toggle = 0
        self._next_heartbeat = 0.0
        self._guard_deadline: float | None = None
        self._heartbeat_deadline: float | None = None

    def command(self, data: bytes) -> None:
        """A frame with identifier 0: command specifier, then the node, 0 for all."""
        if len(data) != 2 or data[1] not in (0, self._node_id) or self.state == BOOTING:
            return
        if data[0] in _STATE_AFTER:
            old, self.state = self.state, _STATE_AFTER[data[0]]
            if old != self.state:
                self._state_changed(old, self.state)
        elif data[0] in (RESET_NODE, _RESET_COMMUNICATION):
            old, self.state = self.state, BOOTING
            self._boot_left = round(BOOT_MS * self._per_ms)
            self._toggle = 0
            self._guard_deadline = self._heartbeat_deadline = None
            self._state_changed(old, BOOTING)
            self._reset(data[0] == RESET_NODE)

    def tick(self, tick: int) -> None:
        """Do all that the time makes due: boot-up, heartbeat, loss of the master."""
        self._tick = tick
        if self.state == BOOTING:
            if self._boot_left > 0:
                self._boot_left -= 1
                return
            self.state = PRE_OPERATIONAL
            self._send(b"\x00")
            self._restart_producer()
            self._state_changed(BOOTING, PRE_OPERATIONAL)
        if self._producer_ms.value and tick >= self._next_heartbeat:
            self._send(bytes((self.state,)))
            self._next_heartbeat = tick + self._producer_ms.value * self._per_ms
        if self._guard_deadline is not None and tick >= self._guard_deadline:
            self._guard_deadline = None
            self._lost()
        if self._heartbeat_deadline is not None and tick >= self._heartbeat_deadline:
            self._heartbeat_deadline = None
            self._lost()

    def guard_request(self) -> None:
        """A remote frame under 700h + node ID: answer with state and toggle bit; life guarding starts with the first.

        A node that produces heartbeats does not answer (one of the two only, CiA 301).
        """
        if self.state == BOOTING or self._producer_ms.value:
            return
        self._send(bytes((self.state | self._toggle,)))
        self._toggle ^= 0x80
        life_time = self._guard_time_ms.value * self._life_time_factor.value * self._per_ms
        self._guard_deadline = self._tick + life_time if life_time else None

    def heard(self, node_id: int) -> None:
        """A heartbeat of another node; the one named in 1016h is watched from its first on."""
        watched = self._consumer.value
        if watched >> 16 & 0x7F == node_id and watched & 0xFFFF and self.state != BOOTING:
            self._heartbeat_deadline = self._tick + (watched & 0xFFFF) * self._per_ms

    def _lost(self) -> None:
        """The application hears of it first: in the state Stopped no emergency goes out any more."""
        self._master_lost()
        after = _AFTER_LOSS.get(self._after_loss if self._behaviour is None else self._behaviour.value)
        if after is not None and self.state == OPERATIONAL:
            self.state = after
            self._state_changed(OPERATIONAL, after)

    def _restart_producer(self) -> None:
        self._next_heartbeat = self._tick + self._producer_ms.value * self._per_ms
        if self._producer_ms.value:
            self._guard_deadline = None

    def _forget_guarding(self) -> None:
        """A life time of 0 switches life guarding off, whatever was running (CiA 301, 7.2.8.2.2)."""
        if not self._guard_time_ms.value * self._life_time_factor.value:
            self._guard_deadline = None

    def _forget_heartbeat(self) -> None:
        self._heartbeat_deadline = None
