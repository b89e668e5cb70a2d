"""``ours=theirs*scale``: how it is read, and what is said when it cannot be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltcomm.errors import UsageError
from beltcomm.foreign.mapping import kept_columns, parse_source, sources_for
from beltcomm.foreign.table import Table

NAMES = ("time", "Iq", "Iq_max", "enc", "pos-actual", "Drive/Speed [1/min]", "Lage (mm)", "cart_mm", "theta_m", "a*b", "t_us")
TABLE = Table("log.csv", {name: np.arange(3.0) for name in NAMES}, {"time": "ms"})


@pytest.mark.parametrize(
    ("text", "theirs", "scale", "offset"),
    [
        ("torque_nm=Iq*0.65", "Iq", 0.65, 0.0),
        ("torque_nm = 0.65 * Iq", "Iq", 0.65, 0.0),
        ("torque_nm=-Iq*1.3/2-0.1", "Iq", -0.65, -0.1),
        ("torque_nm=Iq_max*10ncm+5mnm", "Iq_max", 0.1, 5e-3),
        ("torque_nm=-0.5*iq", "Iq", -0.5, 0.0),
        ("torque_nm=Iq*-0.65", "Iq", -0.65, 0.0),
        ("position_rad=enc*rev/65536", "enc", math.tau / 65536, 0.0),
        ("position_rad=enc*9.587e-5+20deg", "enc", 9.587e-5, math.radians(20.0)),
        ("position_rad=pos-actual*deg", "pos-actual", math.pi / 180, 0.0),
        ('position_rad="pos-actual"*deg - 1', "pos-actual", math.pi / 180, -1.0),
        ("position_rad=a*b*2", "a*b", 2.0, 0.0),
        ("velocity_rad_s=Drive/Speed*rpm", "Drive/Speed [1/min]", math.tau / 60, 0.0),
        ("velocity_rad_s=Drive/Speed [1/min]*1/min", "Drive/Speed [1/min]", math.tau / 60, 0.0),
        ("position_m=Lage*mm+0.2", "Lage (mm)", 1e-3, 0.2),
        ("position_m=theta_m", "theta_m", 1.0, 0.0),
        ("t_s=time*ms", "time", 1e-3, 0.0),
        ("t_s=c1*0.1ms", "time", 1e-4, 0.0),
        ("t_s=t_us*1", "t_us", 1.0, 0.0),
    ],
)
def test_a_mapping_is_read(text: str, theirs: str, scale: float, offset: float) -> None:
    (source,) = (item for item in sources_for(TABLE, [text]).values() if item.column == text.partition("=")[0].strip())
    assert (source.theirs, source.scale, source.offset) == (theirs, pytest.approx(scale), pytest.approx(offset))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("torque_nm", "is no mapping; write OURS=THEIRS"),
        ("torque_nm=", "is no mapping"),
        ("Iq=torque_nm*0.65", r"our column stands on the left: write --map torque_nm=Iq\*0\.65"),
        ("torqe_nm=Iq", r"no column 'torqe_nm' in a recording, did you mean torque_nm\?"),
        ("torque_mnm=Iq", r"columns here are in SI, so it is torque_nm; write --map torque_nm=Iq\*0\.001"),
        ("torque_nm=Iq2*0.65", r"log\.csv has no column 'Iq2', did you mean Iq\?; it has time, Iq, "),
        ("torque_nm=Iq*0,65", r"write the decimal point as '\.'"),
        ("torque_nm=Iq*deg", r"'\*deg' behind 'Iq' is not understood: .*\(Nm, Ncm, mNm, kNm, daNm, kgfm, kgfcm, lbin, lbft, ozin\)"),
        ("torque_nm=Iq/0", "is not understood"),
        ("torque_nm=Iq+1+2", "is not understood"),
        ("torque_nm=Iq Iq", "is not understood"),
        ("t_s=time", r"'time' is in ms by the file itself; write t_s=time\*ms, or \*1"),
        ("t_s=t_us", r"'t_us' is in us by the file itself"),
        ("position_m=Lage", r"'Lage \(mm\)' is in mm by the file itself; write position_m=Lage\*mm"),
        ("position_rad=Lage", r"in mm by the file itself, and position_rad in rad; write the factor"),
        ("cart_position_m=cart_mm", "in mm by the file itself"),
    ],
)
def test_a_mapping_that_cannot_be(text: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        sources_for(TABLE, [text])


def test_a_column_is_mapped_once() -> None:
    with pytest.raises(UsageError, match="torque_nm is already Iq"):
        sources_for(TABLE, ["torque_nm=Iq*0.65", "torque_nm=Iq_max*0.65"])


def test_columns_with_our_names_need_no_mapping_and_yield_to_one() -> None:
    table = Table("log.csv", {name: np.arange(3.0) for name in ("t_s", "torque_nm", "position_rad", "raw")})
    sources = sources_for(table, ["position_rad=raw*deg"])
    assert {name: source.theirs for name, source in sources.items()} == {"position_rad": "raw", "t_s": "t_s", "torque_nm": "torque_nm"}
    assert kept_columns(table, ["all"], sources) == {"position_rad (as found)": "position_rad"}
    with pytest.raises(UsageError, match=r"--keep rew: .*did you mean raw"):
        kept_columns(table, ["rew"], sources)


def test_two_columns_that_differ_in_case_must_be_written_exactly() -> None:
    table = Table("log.csv", {"iq": np.arange(3.0), "IQ": np.arange(3.0)})
    assert parse_source("torque_nm=IQ", table).theirs == "IQ"
    with pytest.raises(UsageError, match="no column 'Iq'"):
        parse_source("torque_nm=Iq", table)
