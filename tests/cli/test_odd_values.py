"""Values that nobody thinks of: each ends in a sentence and a documented exit code, in every command that takes such a value."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.configfiles import find_config, read_yaml, sealed, to_yaml, unsealed
from beltcomm.drive.objects import ParameterObject, object_from_dict
from beltcomm.errors import UsageError
from beltcomm.given import place
from beltcomm.journal import lines_of
from beltcomm.outside import from_json
from beltcomm.quantities import parse_quantity
from beltcomm.runfolder import RunFolder

LONG = "a" * 300
VIRTUAL = ("--drive", "virtual", "--yes", "--seed", "1")


def sentence(words: Sequence[object], codes: Sequence[int] = (2, 3)) -> str:
    outcome = CliRunner().invoke(cli, [str(word) for word in words])
    assert outcome.exit_code in codes, outcome.output
    assert isinstance(outcome.exception, SystemExit) or outcome.exception is None, outcome.exception
    assert "unexpected error" not in outcome.stderr
    assert "Traceback" not in outcome.output
    return outcome.stderr


@pytest.mark.parametrize("name", [LONG, f"there/{LONG}", "a/" * 3000 + "b", f"./{LONG}.yaml"])
@pytest.mark.parametrize(
    "words",
    [
        ["fit"],
        ["bundle"],
        ["convert"],
        ["export", "--format", "yaml"],
        ["verify", *VIRTUAL, "--run"],
        ["commission", *VIRTUAL, "--dry-run", "--run"],
        ["commission", *VIRTUAL, "--dry-run", "--axis"],
        ["commission", *VIRTUAL, "--dry-run", "--profile"],
        ["rollback", "--backup", "list", "--run"],
        ["drives", "--eds"],
        ["import", "--run", "imported"],
        ["init"],
        ["study"],
    ],
)
def test_names_that_no_file_can_have(words: list[str], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    said = sentence([*words, name], codes=(0, 2, 3) if words[-1] == "--run" and "--dry-run" in words and "a/" in name else (2, 3))
    assert LONG[:20] in said or "a/a" in said or not said or "nobody answers" in said


@pytest.mark.examination
def test_an_axis_with_a_long_name_makes_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    axis = tmp_path / "axis.yaml"
    text = find_config("axes", "egc-70-600").read_text(encoding="utf-8")
    axis.write_text(text.replace("name: EGC-70-600", f"name: {LONG}"), encoding="utf-8")
    sentence(["commission", *VIRTUAL, "--dry-run", "--axis", axis], codes=(0,))
    sentence(["identify", *VIRTUAL, "--window", "1mm", "--axis", axis], codes=(1, 2, 3))
    (run,) = (tmp_path / "runs").iterdir()
    assert len(run.name) <= 100


def test_a_path_with_a_zero_is_none() -> None:
    with pytest.raises(UsageError, match="no path holds a zero"):
        place("a\0b")
    with pytest.raises(UsageError, match="zero"):
        api.fit("a\0b")


def test_a_journal_of_other_bytes(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    run.journal("connected to a drive", "connected")
    (run.path / "journal.txt").write_bytes(b"connected to \xff\xfe\n")
    assert lines_of(run.path) == ["connected to \ufffd\ufffd"]
    sentence(["commission", *VIRTUAL, "--dry-run", "--run", run.path], codes=(0, 2))
    RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))  # nothing moved in it: it counts as new


def test_json_deeper_than_anybody_follows() -> None:
    with pytest.raises(ValueError, match="too deeply"):
        from_json("[" * 100_000 + "]" * 100_000)
    with pytest.raises(ValueError, match="digits"):
        from_json("9" * 10_000)
    assert from_json(json.dumps({"a": [1]})) == {"a": [1]}


@pytest.mark.parametrize(
    "value",
    [
        *("9" * 400, "-" + "9" * 400, "0x" + "f" * 400, "9" * 10_000, "!!timestamp x", "!!timestamp 2020-01-01", "!!set {a, b}"),
        *("!!binary aGk=", "!!omap [a: 1]", "!!pairs [a: 1]", "!!python/object:os.system x", "!!int x", "!!int [1]", "!!float {a: 1}"),
        *("!!str [1]", "!!seq x", "!!map x", "&a [*a]", "&a {b: *a}", "*nowhere", "{? [1]: 2}", "{<<: 5}", "{<<: [1]}", "="),
        *("!!bool maybe", "[" * 2000 + "]" * 2000, "\x07"),
    ],
)
def test_yaml_that_is_no_settings_file(tmp_path: Path, value: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(f"key: {value}\n", encoding="utf-8")
    with pytest.raises(UsageError, match="is not valid YAML") as refused:
        read_yaml(path)
    assert len(str(refused.value)) < 400


def test_aliases_do_not_multiply(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]", *(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 9))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(UsageError, match="more than 200000 values"):
        read_yaml(path)
    path.write_text("a: &a [1, 2]\nb: *a\n", encoding="utf-8")
    assert read_yaml(path) == {"a": [1, 2], "b": [1, 2]}


@pytest.mark.parametrize("raw", [float("nan"), float("inf"), 1e300, 10**400, "9" * 400, None, [], {}, "x"])
def test_an_object_of_a_backup_is_a_number(raw: object) -> None:
    with pytest.raises(api.BeltcommError, match="is damaged"):
        object_from_dict({"object": "2100h:1", "type": "real32", "raw": raw})


def test_a_gain_beyond_single_precision_is_a_sentence() -> None:
    with pytest.raises(UsageError, match="beyond the real numbers"):
        ParameterObject(0x2100, 1, "real32").raw("kp_nm_s_rad", 1e300, lambda: 0.0)


def test_a_checksum_holds_what_yaml_keeps(tmp_path: Path) -> None:
    """Written, read and summed again: the same, whatever a name or a text looks like; a digit more and it is not."""
    odd = {
        "1": 1,
        "yes": "no",
        "e": "1e5",
        "f": [0.1 + 0.2, -0.0, float("inf"), 1e-320],
        "t": "2020-01-01",
        "n": None,
        "u": "µ\u2028\x85",
        "": {},
    }
    path = tmp_path / "x.yaml"
    path.write_text(to_yaml(sealed(odd)), encoding="utf-8")
    found, whole = unsealed(read_yaml(path))
    assert whole
    assert found == odd
    path.write_text(to_yaml(sealed(odd)).replace("0.30000000000000004", "0.3"), encoding="utf-8")
    assert not unsealed(read_yaml(path))[1]
    path.write_text(to_yaml(odd), encoding="utf-8")
    assert not unsealed(read_yaml(path))[1]


@pytest.mark.parametrize("name", ["position_m", "payload_kg", "base_speed_m_s", "mounted_kg", "sample_period_s", "longest_s"])
@pytest.mark.parametrize(
    "value",
    [1e308, -1e308, float("nan"), float("inf"), 10**400, 10**5000, "1", True],
    ids=["big", "small", "nan", "inf", "400 digits", "5000 digits", "text", "true"],
)
def test_every_number_of_an_option_has_a_bound(name: str, value: object) -> None:
    with pytest.raises(UsageError, match=name):
        api.Options(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["1e999", "9" * 400, "-1e999 mm"])
def test_a_quantity_is_finite(text: str) -> None:
    with pytest.raises(UsageError, match="more than a number can be"):
        parse_quantity(text, "position_m")
