"""Files of a recording: every fault a sentence with file, column and row; harmless variants are read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from beltcomm.configfiles import to_yaml
from beltcomm.errors import DataError
from beltcomm.recording import load_recording
from beltcomm.recording.sidecar import Sidecar, load_sidecar
from recording.samples import csv_text, signals, write

FILE_FAULTS: dict[str, tuple[bytes | Callable[[], str], str]] = {
    "empty": (b"", "is empty"),
    "header only": (b"t_s,torque_nm,position_rad\n", "has a header and no rows"),
    "no header": (lambda: csv_text().partition("\n")[2], "has no header row"),
    "UTF-16": (lambda: csv_text(), "is UTF-16"),
    "zero bytes": (b"t_s,torque_nm\n\0\0\0\n", "not a text file"),
    "Latin-1": (b"t_s,torque_nm,position_rad,H\xf6he\n", r"not UTF-8 text \(line 1\)"),
    "semicolons": (lambda: csv_text().replace(",", ";"), "separates its columns by semicolons"),
    "semicolons and commas": (lambda: csv_text().replace(",", ";").replace(".", ","), "by semicolons"),
    "tabs": (lambda: csv_text().replace(",", "\t"), "by tabs"),
    "decimal comma": (lambda: csv_text(torque_nm=['"0,5"'] * 50), r"torque_nm in row 1 is '0,5'; write the decimal point as '\.'"),
    "bare decimal comma": (lambda: csv_text(torque_nm=["0,5"] * 50), "row 1 has 4 values, the header 3 names"),
    "missing": (lambda: csv_text(torque_nm=["0.1"] * 16 + [""] + ["0.2"] * 33), "torque_nm in row 17 is missing"),
    "nan": (lambda: csv_text(position_rad=["0.1"] * 16 + ["nan"] + ["0.2"] * 33), "position_rad in row 17 is missing"),
    "infinite": (lambda: csv_text(torque_nm=["0.1"] * 16 + ["inf"] + ["0.2"] * 33), "torque_nm in row 17 is 'inf', not a finite"),
    "text": (lambda: csv_text(torque_nm=["0.1"] * 16 + ["ERR"] + ["0.2"] * 33), "torque_nm in row 17 is 'ERR', not a finite number"),
    "optional missing": (lambda: csv_text(cart_position_m=[""] + ["0.2"] * 49), "cart_position_m in row 1 is missing"),
    "short row": (lambda: csv_text() + "0.06,0.1\n", "row 51 has 2 values, the header 3 names; is the file cut off"),
    "double column": (lambda: csv_text().replace("position_rad", "torque_nm", 1), "two columns called torque_nm"),
    "unnamed column": (lambda: csv_text().replace("torque_nm", "", 1), "has no name for column 2"),
    "time not rising": (lambda: csv_text(t_s=[0.0, 0.001, 0.001, *[0.01 * k for k in range(1, 48)]]), "t_s in row 3 is 0.001 s"),
    "no torque": (lambda: csv_text(torque_nm=None), "has no column torque_nm"),
    "no position": (lambda: csv_text(position_rad=None), "has no column position_rad beside torque_nm"),
    "degrees": (lambda: csv_text().replace("position_rad", "position_deg", 1), "multiply position_deg by 0.0174533"),
    "milliseconds": (lambda: csv_text().replace("t_s", "t_ms", 1), "multiply t_ms by 0.001 and call it t_s"),
    "misspelt": (lambda: csv_text().replace("torque_nm", "Torque_Nmm", 1), r"has no column torque_nm.*did you mean Torque_Nmm"),
    "two sides": (lambda: csv_text().replace("position_rad", "position_m", 1), "has no column position_rad beside torque_nm"),
}


@pytest.mark.parametrize("fault", FILE_FAULTS)
def test_unreadable_files_are_explained(tmp_path: Path, fault: str) -> None:
    content, words = FILE_FAULTS[fault]
    raw = content if isinstance(content, bytes) else content().encode("utf-16" if fault == "UTF-16" else "utf-8")
    path = tmp_path / "a.csv"
    path.write_bytes(raw)
    with pytest.raises(DataError, match=words) as caught:
        load_recording(path)
    assert str(path) in str(caught.value)
    assert [item.name for item in tmp_path.iterdir()] == ["a.csv"]


def test_a_missing_file_is_explained(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="does not exist"):
        load_recording(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace(",", " , "),
        lambda text: text.rstrip("\n"),
        lambda text: text + "\n\n",
        lambda text: "\n".join(line + "," for line in text.splitlines()) + "\n",
    ],
    ids=["byte order mark", "CRLF", "spaces", "no last newline", "blank lines", "trailing comma"],
)
def test_harmless_variants_are_read(tmp_path: Path, change: Callable[[str], str]) -> None:
    loaded = load_recording(write(tmp_path / "a.csv", change(csv_text())))
    assert np.array_equal(loaded.torque, signals(50)["torque"])
    assert np.array_equal(loaded.t_s, signals(50)["t_s"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("experiment: ffr", r"experiment is 'ffr', did you mean frf\?"),
        ("closed_loop: 3", "closed_loop is 3; write true or false"),
        ("start_position_m: 500 mm", "start_position_m is '500 mm'; give a number in m"),
        ("payload_kg: -1", "payload_kg is -1 kg"),
        ("excitation: {amplitude_nm: 0.3}", r"excitation\.kind is missing"),
        ("excitation: {kind: noise}", r"excitation\.kind is 'noise'"),
        ("excitation: {kind: prbs, period_samples: 2.5}", "whole number"),
        ("excitation: {kind: prbs, first_sample: -1}", "at least 0"),
        ("excitation: prbs", "must hold names and values"),
        ("- 1", "holds a list"),
        ("a: [", "not valid YAML"),
    ],
)
def test_wrong_sidecars_are_explained(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path / "a.csv", csv_text())
    write(tmp_path / "a.yaml", text)
    with pytest.raises(DataError, match=words) as caught:
        load_recording(path)
    assert str(tmp_path / "a.yaml") in str(caught.value)


def test_a_misspelt_key_of_the_sidecar_is_noted(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", csv_text())
    write(tmp_path / "a.yaml", "start_positon_m: 0.3\nlicense: MIT\n")
    assert load_recording(path).notes == ("the sidecar's key start_positon_m means nothing here, did you mean start_position_m?",)


def test_an_experiment_at_a_place_that_nobody_knows_says_so(tmp_path: Path) -> None:
    for note, written in ((Sidecar("frf"), True), (Sidecar("frf", start_position_m=0.0), False), (Sidecar("free"), False)):
        assert ("start_position_m" in note.to_dict() and note.to_dict()["start_position_m"] is None) == written
        path = tmp_path / "one.yaml"
        path.write_text(to_yaml(note.to_dict()), encoding="utf-8")
        assert load_sidecar(path) == (note, ())
