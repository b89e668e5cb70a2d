"""``beltcomm serve`` in one process, its host in another, and no CAN in the kernel: a pseudo-terminal lies between them."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.drive import Limits, Motion, open_drive

WAIT_S = 120.0
LIMITS = Limits(0.0, 40.0, 60.0, 0.5)

needs_pty = pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo-terminals")


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The serving process, and what it says where the drive is found."""
    words = [sys.executable, "-m", "beltcomm", "serve", "--on", "slcan", "--drive", "virtual:g_b", "--seed", "3", "--json"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    line = process.stderr.readline()
    found = re.search(r"--drive (slcan:\S+);", line)
    assert found, line + process.stderr.read()
    yield process, found[1]
    if process.poll() is None:
        process.kill()
        process.communicate()


def torque_rows(name: str, options: dict[str, object]) -> list[tuple[float, ...]]:
    rows: list[tuple[float, ...]] = []
    n = 300
    torque = np.where(np.arange(n) // 25 % 2, 0.15, -0.15)
    with open_drive(name, options) as drive:
        assert drive.capabilities.sample_period_s == 1e-3
        report = drive.record(Motion("torque", 1e-3, np.zeros(n), np.zeros(n), torque), LIMITS, rows.append)
    assert (report.rows, report.lost_cycles) == (n, 0)
    return rows


@needs_pty
@pytest.mark.examination
def test_a_record_over_the_pseudo_terminal_is_that_of_one_process(served):
    """Plant, noise, delays and losses of none: every digit of every row."""
    np.testing.assert_array_equal(torque_rows(served[1], {}), torque_rows("virtual:g_b", {"seed": 3}))


@needs_pty
def test_a_command_in_a_process_of_its_own_then_a_clean_end(served):
    process, name = served
    words = [sys.executable, "-m", "beltcomm", "move", "--drive", name, "--axis", "egc-70-600", "--by", "5mm", "--yes", "--json"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert done.returncode == 0, done.stderr
    moved_m = json.loads(done.stdout)["moved_m"]
    assert moved_m == pytest.approx(5e-3, abs=1e-3)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 0
    result = json.loads(out)
    assert result["reached_as"] == name
    assert result["syncs"] > 300
    assert result["frames"] > 2 * result["syncs"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--on", "nowhere"], "no CAN interface"),
        (["--on", "socket:http"], "names no TCP port"),
        (["--on", "socket:99999"], "names no TCP port"),
        (["--on", "slcan", "--drive", "can0"], "no simulated drive"),
        (["--on", "slcan", "--drive", "virtual:nonsense"], "nonsense"),
        (["--on", "slcan", "--profile", "nonsense"], "nonsense"),
        ([], "--on"),
    ],
)
def test_what_cannot_be_served_is_said_in_words(words, says):
    outcome = CliRunner().invoke(cli, ["serve", *words])
    assert outcome.exit_code == 2
    assert says in outcome.stderr


def test_a_can_interface_that_is_missing_says_how_to_bring_it_up():
    outcome = CliRunner().invoke(cli, ["serve", "--on", "vcan97"])
    assert outcome.exit_code == 5
    assert re.search(r"vcan97 cannot be opened.*(ip link|kernel has no CAN)", outcome.stderr)
