"""Files of a stranger: links, pipes, bombs and links inside HDF5 files are refused with a sentence; the process that reads may crash."""

from __future__ import annotations

import gzip
import os
import re
import signal
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from beltcomm import outside
from beltcomm.axis import Axis
from beltcomm.configfiles import read_yaml
from beltcomm.errors import BeltcommError, DataError, UsageError
from beltcomm.foreign import apart
from beltcomm.foreign.convert import Reading, reading_from_dict
from beltcomm.foreign.files import parts_of, read_table
from beltcomm.outside import opened, read_bytes, text_blocks
from beltcomm.runfolder import RunFolder

SECRET = "t,Iq,enc\n" + "".join(f"{k / 1000},{np.sin(k)},{k}\n" for k in range(40))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A stranger's folder beside a file that is none of the stranger's business."""
    (tmp_path / "secret.csv").write_text(SECRET, encoding="utf-8")
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["t"] = np.arange(9.0)
    np.arange(9.0).tofile(tmp_path / "secret.bin")
    inside = tmp_path / "stranger"
    inside.mkdir()
    return inside


def refusal(path: Path) -> str:
    with pytest.raises(BeltcommError) as caught:
        parts_of(path, Reading(), Axis(name="a"))
    assert path.name in str(caught.value)
    return str(caught.value)


def test_links_out_of_a_folder_are_not_followed(folder: Path) -> None:
    (folder / "log.csv").symlink_to(folder.parent / "secret.csv")
    assert "is a link out of its folder" in refusal(folder / "log.csv")
    (folder / "deep").mkdir()
    (folder / "deep" / "log.csv").symlink_to("../../secret.csv")
    assert "is a link out of its folder" in refusal(folder / "deep" / "log.csv")
    (folder / "own.csv").write_text(SECRET, encoding="utf-8")
    (folder / "again.csv").symlink_to("own.csv")
    assert read_table(folder / "again.csv").find("Iq") == "Iq"


def test_a_link_inside_the_run_is_followed_and_no_further(folder: Path) -> None:
    (folder / "own.csv").write_text(SECRET, encoding="utf-8")
    (folder / "deep").mkdir()
    (folder / "deep" / "a").symlink_to("../own.csv")
    (folder / "deep" / "b").symlink_to(folder.parent / "secret.csv")
    with opened(folder / "deep" / "a", within=folder) as file:
        assert file.read(1) == b"t"
    for within in (folder, None):
        with pytest.raises(DataError, match="a link out of its folder"):
            opened(folder / "deep" / "b", within=within)


def test_pipes_devices_and_folders_are_no_files(folder: Path) -> None:
    os.mkfifo(folder / "pipe.csv")
    for path in (folder / "pipe.csv", Path("/dev/zero")):
        with pytest.raises(DataError, match="a pipe or a device, no file"):
            opened(path)
        with pytest.raises(UsageError, match="is no file"):
            read_table(path)
    with pytest.raises(UsageError, match="is a folder"):
        read_yaml(folder, UsageError)


def test_files_beyond_their_size_are_refused(folder: Path) -> None:
    with open(folder / "axis.yaml", "wb") as file:
        file.truncate(outside.SETTINGS_BYTES + 1)
    with pytest.raises(DataError, match=r"axis.yaml has 4 MiB, at most 4 MiB are read"):
        read_bytes(folder / "axis.yaml")
    with open(folder / "a.csv", "wb") as file:
        file.truncate(outside.MEASURED_BYTES + 1)
    assert "at most 4 GiB are read" in refusal(folder / "a.csv")


def test_what_is_packed_unpacks_to_no_more_than_a_measurement(folder: Path) -> None:
    (folder / "a.csv.gz").write_bytes(gzip.compress(b"1,2,3\n" * (1 << 20)))
    with pytest.raises(DataError, match=r"unpacks to more than 1 MiB"):
        list(outside.blocks(folder / "a.csv.gz", 1 << 20))


def test_a_line_without_end_is_no_table(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outside, "_BLOCK", 1000)
    (folder / "a.csv").write_bytes(b"1," * 5000)
    with pytest.raises(DataError, match="has a line of more than"):
        list(text_blocks(folder / "a.csv", "utf-8"))


def test_pieces_are_cut_at_the_ends_of_lines(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for end in ("\n", "\r\n", "\r"):
        text = "".join(f"{k},ä,€{end}" for k in range(500)) + "last"
        (folder / "a.csv").write_bytes(text.encode())
        for size in (7, 64, 1000):
            monkeypatch.setattr(outside, "_BLOCK", size)
            pieces = list(text_blocks(folder / "a.csv", "utf-8"))
            assert "".join(pieces) == text
            assert [line for piece in pieces for line in piece.splitlines()] == text.splitlines()


def test_more_columns_or_values_than_any_measurement(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "wide.csv").write_text("\n".join(",".join(["1"] * 100_000) for _ in range(20)) + "\n", encoding="ascii")
    assert "has 100000 columns, at most 4000 are read" in refusal(folder / "wide.csv")
    with h5py.File(folder / "many.h5", "w", libver="latest") as file:
        for k in range(outside.MOST_COLUMNS + 10):
            file[f"signal {k}"] = np.arange(3.0)
    assert "4001 columns, at most 4000 are read" in refusal(folder / "many.h5")
    monkeypatch.setattr(outside, "MOST_VALUES", 300)
    (folder / "long.csv").write_text("a,b\n" + "1.5,2.5\n" * 151, encoding="ascii")
    assert "more than 150 rows of 2 columns, at most 300 values" in refusal(folder / "long.csv")


@pytest.mark.parametrize("kind", ["external link", "virtual data set", "raw storage"])
def test_hdf5_files_reach_no_other_file(folder: Path, kind: str) -> None:
    for ending in (".h5", ".mat"):
        path = folder / f"a{ending}"
        with h5py.File(path, "w") as file:
            file["own"] = np.arange(9.0)
            if kind == "external link":
                file["x"] = h5py.ExternalLink("../secret.h5", "/t")
            elif kind == "virtual data set":
                layout = h5py.VirtualLayout(shape=(9,), dtype="f8")
                layout[:] = h5py.VirtualSource("../secret.h5", "t", shape=(9,))
                file.create_virtual_dataset("x", layout)
            else:
                file.create_dataset("x", (9,), "f8", external=[("../secret.bin", 0, h5py.h5f.UNLIMITED)])
        assert "another file" in refusal(path)


@pytest.mark.examination
def test_bombs_are_refused_for_their_memory(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(apart, "_MEMORY", 600 << 20)
    with zipfile.ZipFile(folder / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive, archive.open("t.npy", "w") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (1 << 26,)})
        for _ in range(1 << 6):
            file.write(bytes(1 << 23))
    with h5py.File(folder / "bomb.h5", "w") as hdf:
        hdf.create_dataset("t", (1 << 26,), "f8", compression="gzip", chunks=(1 << 20,), fillvalue=1.0)
    element = bytes.fromhex("0e000000") + (450 << 20).to_bytes(4, "little")
    packer = zlib.compressobj(9)
    packed = packer.compress(element) + b"".join(packer.compress(bytes(1 << 23)) for _ in range(57)) + packer.flush()
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    (folder / "bomb.mat").write_bytes(head + bytes.fromhex("0f000000") + len(packed).to_bytes(4, "little") + packed)
    for name in ("bomb.npz", "bomb.h5", "bomb.mat"):
        assert re.search("asks for more than|its reader broke down", refusal(folder / name)), name
    np.savez_compressed(folder / "good.npz", t=np.zeros(1 << 16))
    assert list(read_table(folder / "good.npz").columns) == ["t"]


@pytest.mark.parametrize("how", ["crash", "silence", "nonsense", "half"])
def test_a_reader_may_break_down(folder: Path, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What runs apart is replaced by a program that does what readers do on damaged files."""
    program = {
        "crash": f"import os; os.kill(os.getpid(), {int(signal.SIGSEGV)})",
        "silence": "import time; time.sleep(60)",
        "nonsense": "print('Traceback', 'x' * 3000)",
        "half": r"""import os; t = b'{"fault": "", "columns": [["a", 10]], "units": {}, "clocks": {}, "notes": []}'; """
        r"""os.write(1, len(t).to_bytes(8, 'little') + t + bytes(40))""",
    }[how]
    started = apart.subprocess.Popen
    monkeypatch.setattr(apart.subprocess, "Popen", lambda command, **given: started([command[0], "-c", program], **given))
    monkeypatch.setattr(apart, "_LIMIT_S", 1.0 if how == "silence" else 30.0)
    np.save(folder / "a.npy", np.arange(9.0))
    words = {"crash": "broke down, SIGSEGV", "silence": "did not end within 1 s", "nonsense": "broke down", "half": "broke down"}[how]
    assert words in refusal(folder / "a.npy")


def test_nothing_of_the_working_directory_is_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("numpy", "json", "h5py", "scipy", "beltcomm"):
        (folder / f"{name}.py").write_text("open('ran', 'w').close()\nraise SystemExit(3)\n", encoding="utf-8")
    np.save(folder / "a.npy", np.arange(18.0).reshape(9, 2))
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend("")
    assert list(read_table(Path("a.npy")).columns) == ["c1", "c2"]
    assert not (folder / "ran").exists()


@pytest.mark.parametrize(
    "damaged", [{"period_s": "x"}, {"first_row": 1.5}, {"mapping": [1]}, {"flip": "torque"}, {"torque_acts": "now"}, {"no": 1}, [1], "x"]
)
def test_a_reading_of_a_sidecar_has_its_types(damaged: object) -> None:
    with pytest.raises(DataError, match="import section is damaged"):
        reading_from_dict(damaged)  # type: ignore[arg-type]
    assert reading_from_dict({"period_s": 1, "mapping": ["a=b"], "torque_acts": "after"}) == Reading(
        period_s=1.0, mapping=("a=b",), torque_acts="after"
    )


def test_folders_of_a_run_lead_nowhere_else(folder: Path) -> None:
    run = RunFolder.create(folder / "run", Axis(name="a")).path
    (folder / "elsewhere").mkdir()
    (run / "designs").symlink_to(folder / "elsewhere")
    with pytest.raises(DataError, match="designs is a link out of the run folder"):
        RunFolder.open(run)
    (run / "designs").unlink()
    (run / "designs").symlink_to("recordings")
    assert RunFolder.open(run).axis.name == "a"
    (run / "recordings" / "a.csv").symlink_to(folder.parent / "secret.csv")
    with pytest.raises(DataError, match="a link out of its folder"):
        RunFolder.open(run).recording("a")
