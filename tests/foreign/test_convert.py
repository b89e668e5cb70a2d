"""Tables into columns of a recording: what is scaled, cut, moved, and what is refused with which way out."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.convert import Converted, Reading, alignment, convert, reading_from_dict
from beltcomm.foreign.table import Table
from foreign.samples import MAPPING, swing

T, CURRENT, ENCODER = swing(200)


def table(**changes: Any) -> Table:
    columns: dict[str, Any] = {"time": T, "Iq": CURRENT, "enc": ENCODER} | changes
    return Table("log.csv", {name: np.asarray(column) for name, column in columns.items() if column is not None})


def converted(reading: dict[str, Any] | None = None, **changes: Any) -> Converted:
    return convert(table(**changes), Reading(**({"mapping": MAPPING} | (reading or {}))))


def test_columns_are_scaled_to_si() -> None:
    found = converted()
    assert list(found.columns) == ["t_s", "torque_nm", "position_rad"]
    np.testing.assert_allclose(found.columns["torque_nm"], 0.65 * CURRENT, rtol=1e-14)
    np.testing.assert_allclose(found.columns["position_rad"], math.tau / 65536 * ENCODER, rtol=1e-14)


def test_a_rate_takes_the_place_of_time() -> None:
    found = converted({"period_s": 5e-4, "mapping": MAPPING[1:]}, time=None)
    np.testing.assert_allclose(found.columns["t_s"], 5e-4 * np.arange(200))
    assert "without time stamps: lost samples cannot be seen" in found.notes
    with pytest.raises(UsageError, match=r"nothing says when .*\(time rises by 0\.001 per row.*\).*--map t_s=NAME, or give --rate"):
        converted({"mapping": MAPPING[1:]})


def test_dates_and_times_of_day_are_time_stamps() -> None:
    for pattern in ("2024-05-03 14:02:{:09.6f}", "2024-05-03T14:02:{:09.6f}Z", "14:02:{:09.6f}"):
        found = converted(time=[pattern.format(t + 7.25) for t in T])
        np.testing.assert_allclose(found.columns["t_s"], T, atol=1e-9)
    with pytest.raises(DataError, match="time holds text such as 'soon', no time that is understood"):
        converted(time=["soon"] * 200)


def test_rows_and_time_are_cut() -> None:
    assert len(converted({"first_row": 11, "last_row": 60}).columns["t_s"]) == 50
    found = converted({"from_s": 0.05, "until_s": 0.1})
    np.testing.assert_allclose(found.columns["t_s"], T[50:101])
    for reading, sentence in (
        ({"from_s": 5.0}, "lasts 0.199 s; nothing of it is left"),
        ({"first_row": 300}, "has no row 300; it has 200"),
    ):
        with pytest.raises(UsageError, match=sentence):
            converted(reading)


def test_torque_that_acts_before_its_stamp_moves_one_row() -> None:
    plain, moved = converted().columns, converted({"torque_acts": "before"})
    np.testing.assert_array_equal(moved.columns["torque_nm"], plain["torque_nm"][1:])
    np.testing.assert_array_equal(moved.columns["position_rad"], plain["position_rad"][:-1])
    assert "acts until its own time stamp" in moved.notes[-1]
    assert "no data can tell this error of 1 ms from a real dead time" in alignment(Reading(), plain)


def test_a_counter_that_starts_anew_is_joined() -> None:
    found = converted({"unwrap": "1rev"}, enc=ENCODER % 65536)
    np.testing.assert_allclose(found.columns["position_rad"], math.tau / 65536 * ENCODER, atol=1e-9)
    with pytest.raises(UsageError, match="--unwrap is 0rev"):
        converted({"unwrap": "0rev"})


def with_nan(*rows: int) -> Any:
    current = CURRENT.copy()
    current[list(rows)] = math.nan
    return current


def test_missing_values_at_the_ends_go_and_inside_are_refused() -> None:
    found = converted(Iq=with_nan(0, 1, 199))
    assert len(found.columns["t_s"]) == 197
    assert found.notes[-1] == "3 rows without a value left out, the first is row 1"
    with pytest.raises(DataError, match=r"2 of 200 rows miss a value, first torque_nm in row 51; .*--drop-incomplete"):
        converted(Iq=with_nan(50, 60))
    assert len(converted({"drop_incomplete": True}, Iq=with_nan(50, 60)).columns["t_s"]) == 198
    with pytest.raises(DataError, match="the column for torque_nm holds no value"):
        converted(Iq=with_nan(*range(200)))
    with pytest.raises(DataError, match="in every row a value is missing"):
        converted(Iq=with_nan(*range(0, 200, 2)), enc=np.where(np.arange(200) % 2, math.nan, ENCODER))


def test_rows_written_twice_are_taken_once() -> None:
    twice = np.sort(np.concatenate((np.arange(200), [5, 7])))
    found = converted(time=T[twice], Iq=CURRENT[twice], enc=ENCODER[twice])
    np.testing.assert_array_equal(found.columns["t_s"], T)
    assert found.notes[-1] == "2 rows that repeat the row before left out, the first is row 7"


def test_an_axis_at_rest_under_coarse_stamps_is_not_written_twice() -> None:
    """Stamps of 1 ms at 2 kHz: rows at rest repeat the one before; the rate is that of all rows, to the one or two that the stamps bear."""
    t_s, still = 5e-4 * np.arange(200), np.arange(200) < 80
    with pytest.raises(DataError, match="coarser than the sampling") as refused:
        converted(time=np.round(t_s, 3), Iq=np.where(still, 0.0, CURRENT), enc=np.where(still, 0, ENCODER))
    (rate,) = re.findall(r"--rate ([\d.]+)Hz", str(refused.value))
    assert float(rate) == pytest.approx(2000.0, rel=2.0 / 200.0)


def test_a_rate_that_the_stamps_contradict_is_told() -> None:
    told = "its stamps say 1000 Hz from the first row to the last"
    assert any(told in note for note in converted({"period_s": 1.02e-3}).notes)
    assert not any("stamps say" in note for note in converted({"period_s": 1e-3}).notes)
    assert not any("stamps say" in note for note in converted({"period_s": 1e-3}, time=["soon"] * 200).notes)


@pytest.mark.parametrize(
    ("time", "sentence"),
    [
        (np.concatenate((T[:120], T[:80])), r"time goes back by 0\.119 s in row 121; .*--rows :120 or --rows 121:"),
        (np.round(T, 2), r"179 time stamps repeat, .*resolution of 0\.01 s, .*give --rate \d+"),
        (np.where(np.arange(200) == 9, T[8], T), "1 time stamps repeat, the first in row 10; other values go on there, so the clock stood"),
        (1e3 * T, r"rises by 1 s per row.*t_s=NAME\*ms, if it counts the rows give --rate"),
        (1e6 * T, r"rises by 1000 s per row.*t_s=NAME\*us"),
    ],
)
def test_time_that_cannot_be(time: Any, sentence: str) -> None:
    with pytest.raises(DataError, match=sentence):
        converted(time=time)


def test_columns_of_another_length_or_of_text() -> None:
    with pytest.raises(DataError, match=r"differ in length \(time 200, Iq 100, enc 200\)"):
        converted(Iq=CURRENT[:100])
    with pytest.raises(DataError, match="Iq holds text such as 'on'"):
        converted(Iq=["on"] * 200)


def test_how_it_was_read_comes_back_from_the_sidecar() -> None:
    reading = Reading(mapping=MAPPING, period_s=1e-3, last_row=7, torque_acts="before", keep=("all",), unwrap="1rev")
    assert reading_from_dict(reading.to_dict()) == reading
    assert Reading().to_dict() == {}
    with pytest.raises(DataError, match="import section is damaged"):
        reading_from_dict({"speed": 3})
    for wrong in ({"period_s": 0.0}, {"first_row": 0}, {"first_row": 5, "last_row": 3}):
        with pytest.raises(UsageError):
            Reading(**wrong)
