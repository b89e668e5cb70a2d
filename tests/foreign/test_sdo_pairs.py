"""SDO requests and answers that changed places in a log, or of which one is missing: each answer belongs to the request that it names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from beltcomm.foreign.canopen import Seen, objects_seen, unanswered_mappings
from beltcomm.foreign.framelog import FrameLog, read_frames
from beltcomm.virtual.bus import Frame
from foreign.buslog import Logged, logged
from foreign.test_damaged_logs import EPOCH, stamps_of
from foreign.test_logclock import check_three, imported, text

SDO = (0x581, 0x601)


@pytest.fixture(scope="module")
def three() -> Logged:
    return logged()


def swapped(frames: Sequence[Frame], share: float, seed: int) -> list[Frame]:
    """A share of the SDO frames behind the one that follows them, each of a pair of its own; the stamps stay in order."""
    places = [k for k, frame in enumerate(frames[:-1]) if frame[1] in SDO]
    found, moved = list(frames), -2
    for k in sorted(np.random.default_rng(seed).choice(places, round(share * len(places)), replace=False).tolist()):
        if k > moved + 1:
            found[k], found[k + 1], moved = found[k + 1], found[k], k
    return found


@pytest.mark.parametrize("share", [0.02, 0.3])
def test_requests_and_answers_that_changed_places_cost_no_move(share: float, three: Logged, tmp_path: Path) -> None:
    content = text(swapped(three.frames, share, 1), EPOCH + stamps_of(three.frames))
    outcome, run = imported(tmp_path, "a.log", content, "--start-position", "250mm")
    assert outcome.exit_code == 0, outcome.output
    check_three(run, three)
    assert "no answer in the log" not in outcome.output


def test_a_mapping_that_nobody_confirmed_is_told(three: Logged, tmp_path: Path) -> None:
    """The answer to the write of an entry of the mapping is missing: what the frames carry is what stood there, or what was written."""
    frames = list(three.frames)
    answer = next(k for k, frame in enumerate(frames) if frame[1] == 0x581 and frame[2][:4] == bytes.fromhex("60001a01"))
    del frames[answer]
    log = read_frames(written(tmp_path, frames))
    assert unanswered_mappings(log, 1) == [(0x1A00, 1)]
    outcome, _ = imported(tmp_path, "a.log", text(frames, EPOCH + stamps_of(frames)))
    assert "1 requests to the mapping of PDOs have no answer in the log (the first to 1A00h:1)" in outcome.output


def written(place: Path, frames: Sequence[Frame]) -> Path:
    path = place / "frames.log"
    path.write_text(text(frames, EPOCH + stamps_of(frames)), encoding="utf-8")
    return path


def log_of(place: Path, said: Sequence[tuple[int, str]], period_s: float = 2e-4) -> FrameLog:
    return read_frames(
        written(place, [(period_s * k, identifier, bytes.fromhex(data), "node") for k, (identifier, data) in enumerate(said)])
    )


def values(found: Sequence[Seen]) -> list[tuple[int, int, bool]]:
    return [(item.place[0], int.from_bytes(item.value, "little"), item.written) for item in found]


ASK_1, SAY_1 = (0x601, "4076600000000000"), (0x581, "437660009a020000")  # 6076h is 666
ASK_2, SAY_2 = (0x601, "4075600000000000"), (0x581, "4375600058000000")  # 6075h is 88
SET, DONE = (0x601, "2b72600064000000"), (0x581, "6072600000000000")  # 6072h becomes 100
ASK_SET, SAY_SET = (0x601, "4072600000000000"), (0x581, "4b72600050000000")  # and reads 80


@pytest.mark.parametrize(
    "said",
    [
        (ASK_1, SAY_1, ASK_2, SAY_2),
        (SAY_1, ASK_1, ASK_2, SAY_2),
        (ASK_1, ASK_2, SAY_1, SAY_2),
        (ASK_1, ASK_2, SAY_2, SAY_1),
        (ASK_1, SAY_1, SAY_2, ASK_2),
        (SAY_1, ASK_1, SAY_2, ASK_2),
    ],
)
def test_each_answer_belongs_to_what_it_names(said: Sequence[tuple[int, str]], tmp_path: Path) -> None:
    assert sorted(values(objects_seen(log_of(tmp_path, said)))) == [(0x6075, 88, False), (0x6076, 666, False)]


def test_an_answer_long_before_a_request_is_none_to_it(tmp_path: Path) -> None:
    assert objects_seen(log_of(tmp_path, (SAY_1, ASK_1), period_s=0.1)) == []
    assert objects_seen(log_of(tmp_path, (SAY_1, *[(0x181, "2706")] * 9, ASK_1))) == []


def test_an_answer_that_came_twice_is_none_to_the_next_request(tmp_path: Path) -> None:
    later = (0x581, "437660009b020000")
    assert values(objects_seen(log_of(tmp_path, (ASK_1, SAY_1, SAY_1, ASK_1, later)))) == [(0x6076, 666, False), (0x6076, 667, False)]


def test_what_a_drive_made_of_a_value_stays_and_what_was_read_before_it_does_not(tmp_path: Path) -> None:
    assert values(objects_seen(log_of(tmp_path, (SET, DONE, ASK_SET, SAY_SET)))) == [(0x6072, 100, True), (0x6072, 80, False)]
    assert values(objects_seen(log_of(tmp_path, (ASK_SET, SET, DONE, SAY_SET)))) == [(0x6072, 100, True)]
