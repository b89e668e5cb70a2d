"""Dates as numbers of days: read by content, told, as exact as the file has them; what only looks like them is left alone."""

from __future__ import annotations

from collections.abc import Callable
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from beltcomm.cli.main import cli
from beltcomm.foreign.daystamps import are_days, seconds_of_days
from beltcomm.recording import load_recording
from foreign.makers import ANGLE, ROWS, TORQUE, Array, table

#: 2023-03-15 10:59:58.8 in the 1900 system: the record passes a full hour.
BEGAN = Decimal(45000) + Decimal("39598.8") / 86400


def serial(seconds: Array, decimals: int, began: Decimal = BEGAN) -> list[str]:
    """Numbers of days as a spreadsheet writes them, by decimal arithmetic."""
    unit = Decimal(1).scaleb(-decimals)
    return [str((began + Decimal(repr(round(float(s), 9))) / 86400).quantize(unit, ROUND_HALF_EVEN)) for s in seconds]


def imported(folder: Path, stamps: list[str], *words: str, name: str = "Datum", comma: bool = False) -> tuple[Result, Path]:
    rows = table(f"{name};Torque [Nm];Position [rad]", (stamps, TORQUE[: len(stamps)], ANGLE[: len(stamps)]), ";")
    (folder / "a.csv").write_text(rows.replace(".", ",") if comma else rows, encoding="utf-8")
    return CliRunner().invoke(cli, ["import", str(folder / "a.csv"), "--run", str(folder / "run"), *words]), folder / "run" / "recordings"


def even(period_s: float) -> Array:
    return period_s * np.arange(ROWS)


@pytest.mark.parametrize("name", ["Datum", "Date", "Time", "Zeitstempel", "DateTime"])
@pytest.mark.parametrize(
    ("began", "system"),
    [
        (BEGAN, "a spreadsheet's days since 1900, beginning 2023-03-15 10:59:59 (in the 1904 system 2027-03-16); only"),
        (BEGAN - 1462, "a spreadsheet's days since 1900, beginning 2019-03-14 10:59:59 (in the 1904 system 2023-03-15); only"),
        (BEGAN + 693960, "MATLAB's days, beginning 2023-03-15 10:59:59; only"),
    ],
    ids=["1900", "1904", "matlab"],
)
def test_a_date_as_a_number_is_a_time_stamp_and_told(name: str, began: Decimal, system: str, tmp_path: Path) -> None:
    """As a sheet writes all its fifteen digits; whole milliseconds come back exactly, though a double has them to 0.6 µs."""
    outcome, records = imported(tmp_path, serial(even(1e-3), 10, began), name=name, comma=name == "Datum")
    assert outcome.exit_code == 0, outcome.output
    told = " ".join(outcome.output.split())
    assert f"{name} holds {system} their differences count" in told
    assert "in whole milliseconds" in told
    record = load_recording(next(records.glob("*.csv")))
    np.testing.assert_allclose(record.t_s - record.t_s[0], even(1e-3), atol=1e-9)


@pytest.mark.parametrize(
    ("period_s", "decimals", "exact_s", "said"),
    [
        (1e-3, 12, 1e-9, "in whole milliseconds"),
        (2.5e-4, 12, 1e-9, "in whole 0.01 ms"),
        (1.0 / 3000.0, 12, 1e-6, "exact to 0.000629 ms (0.19 % of a step)"),
        (1.0 / 300.0, 8, 8.7e-4, "exact to 0.864 ms (26 % of a step)"),
        (4e-3, 8, 8.7e-4, "exact to 0.864 ms (22 % of a step)"),
    ],
)
def test_the_resolution_is_that_of_the_file(period_s: float, decimals: int, exact_s: float, said: str, tmp_path: Path) -> None:
    outcome, records = imported(tmp_path, serial(even(period_s), decimals))
    assert outcome.exit_code == 0, outcome.output
    assert said in " ".join(outcome.output.split())
    record = load_recording(next(records.glob("*.csv")))
    np.testing.assert_allclose(record.t_s - record.t_s[0], even(period_s), atol=exact_s)


def test_coarser_than_the_sampling_the_rate_is_asked_for(tmp_path: Path) -> None:
    """Six decimals are 86 ms."""
    outcome, _ = imported(tmp_path, serial(even(1e-3), 6))
    assert outcome.exit_code == 3
    assert "the stamps have a resolution of 0.0864 s, coarser than the sampling" in " ".join(outcome.output.split())
    again, records = imported(tmp_path, serial(even(1e-3), 6), "--rate", "1kHz")
    assert again.exit_code == 0, again.output
    record = load_recording(next(records.glob("*.csv")))
    np.testing.assert_allclose(record.t_s, even(1e-3), atol=1e-12)


def test_a_time_of_day_without_its_date(tmp_path: Path) -> None:
    outcome, records = imported(tmp_path, serial(even(1e-3), 12, BEGAN - 45000), name="Uhrzeit")
    assert outcome.exit_code == 0, outcome.output
    assert "times of day, as fractions of one" in " ".join(outcome.output.split())
    record = load_recording(next(records.glob("*.csv")))
    np.testing.assert_allclose(record.t_s - record.t_s[0], even(1e-3), atol=1e-9)


@pytest.mark.parametrize("words", [("--map", "t_s=Datum"), ("--map", "t_s=Datum*d")])
def test_a_mapping_by_hand_reads_the_same(words: tuple[str, ...], tmp_path: Path) -> None:
    outcome, records = imported(
        tmp_path, serial(even(1e-3), 10), *words, "--map", "torque_nm=Torque*Nm", "--map", "position_rad=Position*rad"
    )
    assert outcome.exit_code == 0, outcome.output
    record = load_recording(next(records.glob("*.csv")))
    np.testing.assert_allclose(record.t_s - record.t_s[0], even(1e-3), atol=1e-9)


def test_a_factor_of_one_s_own_is_a_factor(tmp_path: Path) -> None:
    """Imports of before repeat bit by bit."""
    stamps = serial(even(1e-3), 10)
    words = ("--map", "t_s=Datum*86400", "--map", "torque_nm=Torque*Nm", "--map", "position_rad=Position*rad")
    outcome, records = imported(tmp_path, stamps, *words)
    assert outcome.exit_code == 0, outcome.output
    assert "holds" not in outcome.output
    t_s = load_recording(next(records.glob("*.csv"))).t_s
    np.testing.assert_array_equal(t_s - t_s[0], 86400.0 * np.array([float(s) for s in stamps]) - 86400.0 * float(stamps[0]))


@pytest.mark.parametrize(("name", "scale"), [("Time [h]", 3600.0), ("Operating hours [h]", 3600.0), ("Time [s]", 1.0)])
def test_a_unit_that_the_file_states_is_the_time_s(name: str, scale: float, tmp_path: Path) -> None:
    """45 000 operating hours looked like a date."""
    hours = [f"{45_000.12 + 1e-3 * k / scale:.15g}" for k in range(ROWS)]
    outcome, records = imported(tmp_path, hours, name=name)
    assert "days" not in outcome.output
    assert (outcome.exit_code == 0) is name.startswith("Time"), "an unusual name is asked for"
    if name.startswith("Time"):
        record = load_recording(next(records.glob("*.csv")))
        assert float(np.median(np.diff(record.t_s))) == pytest.approx(1e-3, rel=1e-3)


@pytest.mark.parametrize(
    "values",
    [
        lambda rng: 45_000.0 + np.cumsum(1e-7 * (rng.random(500) < 0.3)),  # mm, hardly moving
        lambda rng: 45_000.0 + np.cumsum(rng.exponential(2e-7, 500)),  # kWh
    ],
)
def test_what_moves_around_such_numbers_is_no_time(values: Callable[[np.random.Generator], Array]) -> None:
    column = values(np.random.default_rng(3))
    assert are_days(column), "by its values alone"
    assert not are_days(column, named=False)


@pytest.mark.parametrize(
    "stamps",
    [
        lambda rng: 45_000.0 + np.cumsum(rng.uniform(5e-5, 5e-3, 500)),  # s of a clock that runs for half a day
        lambda rng: 45_000.0 + np.arange(500.0),  # rows, or ms
        lambda rng: 700_000.0 + 1e-3 * np.arange(500.0),
        lambda rng: 1.7e9 + 1e-3 * np.arange(500.0),  # s since 1970
        lambda rng: 1e-3 * np.arange(500.0),  # s
        lambda rng: (0.5 + 1e-3 * np.arange(500.0)) / 60.0,  # min
        lambda rng: (0.5 + 2e-3 * np.arange(500.0)) / 3600.0 * 24.0,  # h, as steps of a day of 48 ms
        lambda rng: np.full(500, 45_000.5),
        lambda rng: 45_000.0 + 1e-8 * rng.permutation(500),  # no clock goes so, but its span is that of one
    ],
)
def test_seconds_milliseconds_rows_and_hours_are_no_days(stamps: Callable[[np.random.Generator], Array]) -> None:
    values = stamps(np.random.default_rng(7))
    assert not are_days(values)


@pytest.mark.parametrize("seed", range(20))
def test_any_date_of_our_time_at_any_sampling_is_read_to_its_resolution(seed: int) -> None:
    rng = np.random.default_rng(seed)
    period_s, began = 10.0 ** rng.uniform(-4.0, -1.7), Decimal(repr(rng.uniform(25_000.0, 75_000.0)))
    t = np.cumsum(period_s * rng.uniform(0.7, 1.3, 300))
    values = np.array([float(began + Decimal(repr(float(s))) / 86400) for s in t])
    assert are_days(values)
    seconds, notes = seconds_of_days("t", values)
    np.testing.assert_allclose(seconds, t - t[0], atol=2.1 * 86400.0 * np.spacing(75_000.0))
    assert "whole" not in notes[0], "uneven stamps are no whole milliseconds"


def test_a_long_table_may_have_them_too(tmp_path: Path) -> None:
    stamps, order = serial(even(1e-3), 10), np.arange(ROWS).repeat(2)
    names, values = ["torque_nm", "position_rad"] * ROWS, np.stack((TORQUE, ANGLE), axis=1).ravel()
    (tmp_path / "a.csv").write_text(table("Date;signal;value", ([stamps[k] for k in order], names, values), ";"), encoding="utf-8")
    outcome = CliRunner().invoke(cli, ["import", str(tmp_path / "a.csv"), "--run", str(tmp_path / "run")])
    assert outcome.exit_code == 0, outcome.output
    record = load_recording(next((tmp_path / "run" / "recordings").glob("*.csv")))
    np.testing.assert_allclose(record.t_s - record.t_s[0], even(1e-3), atol=1e-9)
    np.testing.assert_allclose(record.torque, TORQUE, atol=1e-9)
