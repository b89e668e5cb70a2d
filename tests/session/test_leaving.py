"""How a session leaves its drive: what is refused once is written all the same, what is refused twice is said."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import cast

import pytest

from beltcomm.axis import load_axis
from beltcomm.drive import Drive
from beltcomm.errors import BusError, DriveError, ObjectRefused
from beltcomm.machine.restore_drive import leave
from beltcomm.runfolder import RunFolder
from session.bench import Listener

WANTED = {"kp_nm_s_rad": 0.1, "ki_nm_rad": 2.0}
REFUSED = ObjectRefused("kp_nm_s_rad: 2100h:1 was refused", 0x08000022, 0x2100, 1)


class Refusing:
    """A drive that answers its first writes with these errors."""

    def __init__(self, *errors: DriveError) -> None:
        self._errors = list(errors)
        self.calls: list[str] = []
        self.values: dict[str, float] = {}

    def stop(self) -> None:
        self.calls.append("stop")

    def write(self, values: Mapping[str, float]) -> dict[str, float]:
        self.calls.append("write")
        if self._errors:
            raise self._errors.pop(0)
        self.values |= values
        return dict(values)


@pytest.mark.parametrize(
    ("errors", "writes", "said"),
    [
        ((), 1, ""),
        ((REFUSED,), 2, ""),  # a passing state of the drive
        ((REFUSED, REFUSED), 2, "2100h:1 was refused"),
        ((BusError("the drive does not answer"),), 1, "the drive does not answer"),  # its wire has had its own tries already
    ],
)
def test_a_write_refused_once_is_survived(tmp_path: Path, errors: tuple[DriveError, ...], writes: int, said: str) -> None:
    drive, talk, folder = Refusing(*errors), Listener(), RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    assert leave(cast(Drive, drive), folder, talk, WANTED, False, None) is None
    assert drive.calls == ["stop", *["write"] * writes]
    assert drive.values == ({} if said else WANTED)
    journal = (folder.path / "journal.txt").read_text(encoding="utf-8")
    assert ("all parameters restored" in journal) == (not said)
    assert ("restoring the drive failed" in journal and said in journal) == bool(said)
    assert [said in line and "`beltcomm rollback` writes the backup again" in line for line in talk.said] == [True] * bool(said)
