"""Damaged files of every kind: bytes changed, cut and repeated by a seed; each is read or refused with a sentence, never a traceback."""

from __future__ import annotations

from pathlib import Path

import can
import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.axis import Axis
from beltcomm.errors import BeltcommError, DataError
from beltcomm.foreign.convert import Reading
from beltcomm.foreign.files import parts_of
from foreign.matfiles import write_v5, write_v73
from foreign.samples import swing, text
from marks import quick

T, CURRENT, ENCODER = swing(60)
CASES = 40
#: The same where each file starts a reader of its own, or takes long.
CASES_APART = 6
VALUE = {"t": T, "log": {"Time": T, "Data": CURRENT, "Unit": "A"}, "c": [ENCODER, "text"], "s": [{"x": T}, {"x": CURRENT}]}


def sdo(command: int, index: int, subindex: int, value: int) -> bytes:
    return bytes([command]) + index.to_bytes(2, "little") + bytes([subindex]) + value.to_bytes(4, "little")


def bus() -> list[can.Message]:
    """A small session: ratings and units read, one PDO mapped, SYNCs answered."""
    asked = [(0x6076, 0, 1430), (0x608F, 1, 65536), (0x608F, 2, 1)]
    written = [
        (0x1A00, 0, 0),
        (0x1A00, 1, 0x60640020),
        (0x1A00, 2, 0x60770010),
        (0x1A00, 3, 0x60410010),
        (0x1A00, 0, 3),
        (0x1800, 1, 0x181),
    ]
    pairs = [(sdo(0x40, i, s, 0), sdo(0x43, i, s, v)) for i, s, v in asked] + [
        (sdo(0x23, i, s, v), sdo(0x60, i, s, 0)) for i, s, v in written
    ]
    frames = [(identifier, data) for pair in pairs for identifier, data in zip((0x601, 0x581), pair, strict=True)]
    for k, (current, position) in enumerate(zip(CURRENT, ENCODER, strict=True)):
        sample = int(position).to_bytes(4, "little", signed=True) + int(100 * current).to_bytes(2, "little", signed=True) + b"\x37\x06"
        frames += [(0x80, b""), (0x181, sample)]
        del k
    return [can.Message(1e3 + 5e-3 * n, identifier, False, data=data, channel=0) for n, (identifier, data) in enumerate(frames)]


def logged(path: Path, writer: type) -> bytes:
    with writer(str(path)) as file:
        for message in bus():
            file.on_message_received(message)
    return path.read_bytes()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """One good file of each kind."""
    folder = tmp_path_factory.mktemp("whole")
    np.savez(folder / "a.npz", t=T, i=CURRENT)
    return {
        "v5.mat": write_v5(folder / "5.mat", VALUE).read_bytes(),
        "v73.mat": write_v73(folder / "7.mat", VALUE).read_bytes(),
        "a.npz": (folder / "a.npz").read_bytes(),
        "a.csv": text("t [s],Iq,enc", samples=40).encode(),
        "a.log": logged(folder / "a.log", can.CanutilsLogWriter),
        "a.asc": logged(folder / "a.asc", can.ASCWriter),
        "a.blf": logged(folder / "a.blf", can.BLFWriter),
        "a.trc": logged(folder / "a.trc", can.TRCWriter),
    }


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes changed at up to eight places, a piece cut out or written twice, or the end missing."""
    data: NDArray[np.uint8] = np.frombuffer(content, dtype=np.uint8).copy()
    places = rng.integers(0, len(data), rng.integers(1, 9))
    data[places] = rng.integers(0, 256, len(places), dtype=np.uint8)
    first, last = sorted(rng.integers(0, len(data), 2).tolist())
    kind = rng.integers(0, 4)
    if kind == 0:
        return data.tobytes()[:last]
    if kind == 1:
        return data.tobytes()[:first] + data.tobytes()[last:]
    if kind == 2:
        return data.tobytes()[:last] + data.tobytes()[first:]
    return data.tobytes()


@pytest.mark.parametrize("kind", quick(["a.csv", "a.log", "a.asc", "a.npz", "v5.mat", "v73.mat", "a.blf", "a.trc"], 5))
def test_damage_gives_a_sentence(whole: dict[str, bytes], kind: str, tmp_path: Path) -> None:
    assert parts_of_bytes(whole[kind], tmp_path / f"whole-{kind}"), "the whole file is read"
    rng = np.random.default_rng(int.from_bytes(kind.encode(), "little") % 2**32)
    refused: list[tuple[str, str]] = []
    for case in range(CASES_APART if kind in {"v5.mat", "v73.mat", "a.npz", "a.blf", "a.trc"} else CASES):
        path = tmp_path / f"{case}-{kind}"
        try:
            parts_of_bytes(damaged(whole[kind], rng), path)
        except BeltcommError as error:
            refused.append((str(error), path.name))
    assert refused
    assert [words for words, name in refused if name not in words] == []


def parts_of_bytes(content: bytes, path: Path) -> object:
    path.write_bytes(content)
    return parts_of(path, Reading(), Axis(name="a"))


@pytest.mark.parametrize("kind", quick(["a.log", "a.asc", "a.npz", "v5.mat", "v73.mat", "a.blf"], 5))
def test_an_empty_file_and_its_first_bytes(whole: dict[str, bytes], kind: str, tmp_path: Path) -> None:
    for size in (0, 1, 8, 100):
        with pytest.raises(DataError, match=kind):
            parts_of_bytes(whole[kind][:size], tmp_path / f"{size}-{kind}")
