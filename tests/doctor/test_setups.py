"""Each broken set-up: everything that is not ok, the exact sentence, the exit code; and the page that shows them."""

from __future__ import annotations

import json

import pytest

from doctor.setups import PAGE, SETUPS, Bench, Setup, called, page

Named = tuple[str, str, str]

#: What a sound drive of each kind leaves open or is warned of, by area and name.
USUAL: dict[str, list[Named]] = {
    "reference": [("enabling", "ready", "unknown"), ("timing", "sync", "unknown")],
    "cmmp-as": [("enabling", "control", "warning"), ("watching", "following error", "warning"), ("timing", "sync", "unknown")],
}

#: Exit code, what is found beyond the usual, and the sentence of the first.
EXPECTED: dict[str, tuple[int, list[Named], str]] = {
    "no_interface": (5, [("bus", "interface", "wrong")], "there is no CAN interface can7 on this machine; there are can0"),
    "interface_down": (5, [("bus", "interface", "wrong")], "the CAN interface can0 is down"),
    "bus_off": (5, [("bus", "interface", "wrong")], "the CAN interface can0 is bus-off: it saw too many errors and left the bus"),
    "wrong_bitrate": (
        5,
        [("bus", "errors", "wrong"), ("bus", "bit rate", "warning")],
        "what is sent is acknowledged by nobody (ACK error): no other node is on the bus, or its bit rate is another one",
    ),
    "drive_off": (5, [("bus", "nodes", "wrong")], "no node answers on socketcan channel 'can0' at 1000 kbit/s"),
    "two_nodes": (1, [("bus", "nodes", "wrong")], "2 nodes answer on socketcan channel 'can0': 1, 5"),
    "nmt_stopped": (5, [("bus", "nodes", "wrong")], "node 1 is there, but in the NMT state stopped: it answers no question (SDO)"),
    "other_master": (1, [("bus", "other master", "wrong")], "somebody else works on this bus: SYNC, setpoints (PDOs) were heard"),
    "fault": (
        1,
        [("condition", "state", "wrong"), ("condition", "error register", "wrong"), ("condition", "error history", "warning")],
        "the drive is in Fault (6041h = 8218h): error 3220h, voltage of the DC link is too low",
    ),
    "no_dc_link": (
        1,
        [("enabling", "dc link", "wrong")],
        "the DC link is at 0 V (6079h), and no power at the stage is reported (6041h bit 4 is 0)",
    ),
    "sto_open": (
        1,
        [("enabling", "ready", "wrong")],
        "the drive cannot be enabled (2000h:1 bit 2 is 0), with power and no fault: STO open or encoder not ready",
    ),
    "enable_input_low": (
        0,
        [("enabling", "inputs", "warning")],
        "DIN5 (controller enable) reads low in 60FDh (the position of these bits is not confirmed): without it the drive stays in Switch "
        "On Disabled",
    ),
    "enable_logic": (0, [], "the enable logic 6510h:10h is 0: the drive does not obey the bus, only with 2"),
    "local_control": (1, [("enabling", "control", "wrong")], "the drive does not obey the bus (6041h bit 9, remote, is 0)"),
    "gear": (
        1,
        [("axis.yaml", "gear", "wrong")],
        "the drive's gear ratio is 3 (6091h), axis.yaml says 1 (gearbox.ratio): positions would be wrong by the factor 3",
    ),
    "feed": (
        0,
        [("axis.yaml", "feed", "warning")],
        "one motor revolution is 131072 position units: neither the encoder's 65536 increments (2 times) nor the 78.04 mm of axis.yaml in "
        "any decimal unit",
    ),
    "rated_torque": (
        1,
        [("axis.yaml", "rated torque", "wrong"), ("axis.yaml", "torque per current", "wrong"), ("axis.yaml", "largest torque", "wrong")],
        "rated torque 2.86 N m (6076h), axis.yaml says 1.43 N m (motor.rated_torque_nm): every torque, mass and gain would be wrong by the "
        "factor 2.00",
    ),
    "another_machine": (
        1,
        [*USUAL["reference"], *(("axis.yaml", name, "wrong") for name in ("rated torque", "torque per current", "encoder"))],
        "the drive counts 65536 increments per motor revolution, axis.yaml says 1048576 (motor.encoder_counts_per_rev)",
    ),
    "guarding": (
        1,
        [("watching", "host", "wrong"), ("node", "nmt", "unknown")],
        "the drive does not answer node guarding (700h + node): it would not notice that this computer dies",
    ),
    "lost_sync": (
        1,
        [("timing", "sync", "wrong")],
        "1000 SYNCs at 1 ms: 50 not answered in time, worst period error 0 us: too many for a record",
    ),
    "window_off": (
        0,
        [("watching", "following error", "warning")],
        "the following error window is off (6065h = FFFFFFFFh): it never stops the drive",
    ),
    "unreferenced": (
        0,
        [("place", "zero", "warning"), ("axis.yaml", "position", "unknown")],
        "position 0 rad at the motor; the drive does not know its zero (not homed)",
    ),
    "outside": (1, [("axis.yaml", "position", "wrong")], "the carriage stands at 620.0 mm, the travel is -10 to 570 mm: outside"),
    "end_switch": (1, [("place", "end switches", "wrong")], "the lower end switch is active (60FDh bit 0)"),
    "not_a_drive": (
        1,
        [("node", "identity", "wrong")],
        "node 1 is beltcomm reference drive (vendor 0, firmware 1.0), but its device type 1000h = 00030191h names the device profile 401, "
        "not 402 (CiA 402)",
    ),
    "cut_off": (
        0,
        [("watching", "leftovers", "warning"), ("watching", "host", "unknown"), ("node", "nmt", "unknown")],
        "settings of a run that was cut off are still in the drive: node guarding 100Ch",
    ),
    "adapter_broken": (
        1,
        [("adapters of beltcomm", "acme_drives:ADAPTER", "wrong"), ("this machine", "socketcan", "warning")],
        "the adapter acme_drives:ADAPTER cannot be loaded: ModuleNotFoundError: No module named 'acme_lib'",
    ),
    "no_permission": (
        1,
        [("this machine", "/dev/ttyACM0", "wrong"), ("this machine", "socketcan", "warning")],
        "/dev/ttyACM0 (CANable with slcan firmware, USB ad50:60c4): you may not open it",
    ),
    "no_driver": (
        1,
        [("this machine", "usb 0c72:000c", "wrong"), ("this machine", "socketcan", "warning")],
        "a CAN adapter is plugged in (PEAK PCAN-USB, USB 0c72:000c), but it has no can0: its driver is missing",
    ),
    "port_denied": (5, [("serial line", "port", "wrong")], "you may not open /dev/ttyUSB0"),
}


def test_every_setup_has_its_expectation() -> None:
    assert set(EXPECTED) == set(SETUPS)


@pytest.mark.parametrize("name", SETUPS)
def test_a_broken_setup_is_named_and_nothing_else(name: str) -> None:
    code, beyond, sentence = EXPECTED[name]
    bench = SETUPS[name].bench
    usual = list(USUAL[bench.profile]) if isinstance(bench, Bench) else []
    outcome = called(SETUPS[name], "--json")
    told = json.loads(outcome.stdout)
    assert outcome.exit_code == told["exit_code"] == code, outcome.stderr
    found = {(f["area"], f["name"], f["state"]): f for f in told["findings"] if f["state"] != "ok"}
    wanted = set(beyond) | {key for key in usual if key[:2] not in {other[:2] for other in beyond}}
    ended = any(finding["unreachable"] or finding["name"] in ("nodes", "other master") for finding in found.values())
    assert set(found) == (set(beyond) if ended else wanted)
    assert [finding["text"] for finding in found.values() if finding["text"] == sentence], [f["text"] for f in found.values()]
    assert all(finding["remedy"] for finding in found.values() if finding["state"] == "wrong")
    assert told["counts"]["wrong"] == sum(state == "wrong" for *_, state in found)


@pytest.mark.parametrize("profile", USUAL)
def test_a_sound_drive_has_nothing_wrong(profile: str) -> None:
    outcome = called(Setup("", "doctor --drive can0 --axis egc-70-600 --sync-test", Bench(profile)), "--json")
    told = json.loads(outcome.stdout)
    assert outcome.exit_code == 0
    open_ones = [(f["area"], f["name"], f["state"]) for f in told["findings"] if f["state"] != "ok"]
    assert open_ones == [key for key in USUAL[profile] if key[0] != "timing"]
    home = " --home" if ("place", "zero") in [(area, name) for area, name, _ in open_ones] else ""  # without a zero commissioning refuses
    assert told["next"] == f"next: `beltcomm commission --drive can0 --axis egc-70-600{home} --dry-run` shows the plan and moves nothing"


def test_the_page_shows_what_the_command_prints() -> None:
    """``python -m doctor.setups`` in the folder tests writes it anew."""
    assert PAGE.read_text(encoding="utf-8") == page()
