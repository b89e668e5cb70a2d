"""CiA 402 states and fault texts, against the standard's table written out here."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import pytest

from beltcomm_adapters.cia402 import DISABLE_VOLTAGE, QUICK_STOP, State, StateMachine, emergency_text, state_of, step_to_enabled

# CiA 402-2, statusword: x0xx in bits 6,5,3..0 as text, "x" is any
TABLE = {
    "0x0000": State.NOT_READY,
    "1x0000": State.SWITCH_ON_DISABLED,
    "010001": State.READY_TO_SWITCH_ON,
    "010011": State.SWITCHED_ON,
    "010111": State.OPERATION_ENABLED,
    "000111": State.QUICK_STOP_ACTIVE,
    "0x1111": State.FAULT_REACTION_ACTIVE,
    "0x1000": State.FAULT,
}


@pytest.mark.parametrize(("pattern", "state"), TABLE.items())
def test_states_by_the_standards_table_whatever_the_other_bits(pattern, state):
    for bits in itertools.product("01", repeat=pattern.count("x")):
        filled = iter(bits)
        six = "".join(next(filled) if c == "x" else c for c in pattern)
        word = int(six[0]) << 6 | int(six[1]) << 5 | int(six[2:], 2)
        for others in (0x0000, 0x1290, 0xFF90):
            assert state_of(word | others) is state


def test_bit_3_is_a_fault_in_any_pattern():
    assert state_of(0x0B) is State.FAULT
    assert state_of(0x2F) in (State.FAULT, State.FAULT_REACTION_ACTIVE)


def test_the_way_to_operation_enabled_has_three_commands_and_none_out_of_a_fault():
    assert [step_to_enabled(State(n)) for n in (1, 2, 3)] == [0x06, 0x07, 0x0F]
    assert all(step_to_enabled(state) & 0x80 == 0 for state in State)
    assert step_to_enabled(State.FAULT) == 0


def test_a_fault_is_named_by_the_maker_then_by_the_standard():
    assert emergency_text(0x8611, {0x8611: "17-x"}) == "17-x"
    assert emergency_text(0x8130, {}).startswith("life guard")
    assert emergency_text(0x8110, {}) == "CAN overrun: messages were lost"
    assert emergency_text(0x4310, {}) == "temperature"
    assert emergency_text(0xFF01, {}) == "device specific"


@pytest.mark.parametrize(("begins", "command"), [(0x27, QUICK_STOP), (0x07, None), (0x0F, None)])
def test_the_stage_is_taken_off_when_the_axis_has_braked(begins, command):
    """Enabled, in a quick stop, in a fault reaction: Disable Voltage 0.3 s later, not while the drive brakes."""
    now, sent = [0.0], []
    braked = {0x27: 0x40, 0x07: 0x40, 0x0F: 0x08}[begins]

    def statusword(*_place):
        return braked if now[0] > 0.3 else 0x07 if sent else begins

    def wait(seconds):
        now[0] += seconds

    objects = SimpleNamespace(read_int=statusword, write=lambda *given: sent.append((given[-1], now[0])))
    link = SimpleNamespace(clock=SimpleNamespace(now=lambda: now[0]), pump=wait)
    StateMachine(link, objects, {}).disable()
    assert [word for word, _ in sent] == ([command] if command is not None else []) + [DISABLE_VOLTAGE]
    assert sent[-1][1] > 0.3
