"""What a record needs of a drive, tried before anything moves: mapping and limits, and what is told of those that are refused."""

from __future__ import annotations

import pytest

from adapters.stub_node import COUNTS_PER_RAD, StubNode, standard_objects
from adapters.test_record import LIMITS, torque
from beltcomm.drive.access import able
from beltcomm.errors import DriveError

READ_ONLY, RANGE, NOT_MAPPABLE = 0x06010002, 0x06090030, 0x06040041


class FixedMapping(StubNode):
    """unmappable : objects that it does not let be mapped.   most : bytes of a PDO."""

    unmappable: tuple[int, ...] = ()
    most = 8

    def _sdo(self, data: bytes) -> None:
        index, sub = int.from_bytes(data[1:3], "little"), data[3]
        if data[0] != 0x40 and 0x1A00 <= index < 0x1A04:
            entry = int.from_bytes(data[4:8], "little")
            mapped = [int(self.get(index, part)) & 0xFF for part in range(1, sub)] + [entry & 0xFF] if sub else []
            if sub and (entry >> 16 in self.unmappable or sum(mapped) > 8 * self.most):
                self._abort(data[1:4], NOT_MAPPABLE)
                return
        super()._sdo(data)

    def _sync(self, now_s: float) -> None:
        """The stub's two fixed answers, sent as they are mapped here."""
        count, mean_nm = len(self.out), self.acting_nm
        super()._sync(now_s)
        frames = [self.out.pop() for _ in range(len(self.out) - count)][::-1]
        answers = dict(frames)
        self.out.extend(frame for frame in frames if frame[0] not in (0x181, 0x281))
        if 0x181 not in answers:
            return
        first, second = answers[0x181], answers[0x281]
        parts = {0x6064: first[:4], 0x6077: first[4:6], 0x6041: first[6:], 0x606C: second[:4], 0x6074: second[4:]} | self.further(mean_nm)
        for number in range(3):
            if (0x1800 + number, 1) in self.objects and not int(self.get(0x1800 + number, 1)) & 1 << 31:
                mapped = [int(self.get(0x1A00 + number, part)) >> 16 for part in range(1, 1 + int(self.get(0x1A00 + number)))]
                self.out.append((0x181 + 0x100 * number, b"".join(parts[index] for index in mapped)))

    def further(self, _mean_nm: float) -> dict[int, bytes]:
        """Other objects that may be mapped."""
        return {}


def objects_with_four() -> dict[tuple[int, int], tuple[str, float]]:
    objects = standard_objects()
    objects |= {
        (0x1802, 1): ("<I", 0xC0000381),
        (0x1802, 2): ("<B", 255),
        **{(0x1A02, sub): ("<I" if sub else "<B", 0) for sub in range(5)},
    }
    return objects


def test_a_plain_drive_takes_everything_and_keeps_nothing(opened):
    node = StubNode()
    drive = opened(node)
    before = dict(node.objects)
    assert {one.state for one in drive.trial()} == {"ok"}
    assert node.objects == before


@pytest.mark.parametrize(
    ("place", "code", "words"),
    [
        ((0x6065, 0), READ_ONLY, "host alone stops the axis when it lags"),
        ((0x6085, 0), RANGE, "not as the plan says"),
        ((0x6072, 0), RANGE, "too much torque"),
        ((0x6080, 0), READ_ONLY, "too much speed"),
    ],
)
def test_a_refused_limit_is_told_with_what_stops_the_axis_instead(opened, place, code, words):
    node = StubNode(refuse={place: code})
    node.objects |= {(0x6065, 0): ("<I", 10000), (0x6085, 0): ("<I", 10**9), (0x6084, 0): ("<I", 10**9)}
    drive = able(opened(node), "torque")
    (caution,) = drive.capabilities.cautions
    assert words in caution
    assert f"{place[0]:04X}h" in caution
    assert f"{code:08X}h" in caution
    assert place[0] in drive.capabilities.not_taken
    drive.record(torque([0.1] * 5), LIMITS, lambda row: None)


def test_what_a_drive_does_not_have_passes_in_silence(opened):
    node = StubNode()
    for place in ((0x6065, 0), (0x607D, 1), (0x607D, 2), (0x605A, 0)):
        node.objects.pop(place, None)
    assert able(opened(node), "torque").capabilities.cautions == ()


def test_a_fixed_mapping_is_refused_before_motion_in_hexadecimal(opened):
    node = StubNode(refuse={(0x1600, sub): READ_ONLY for sub in range(5)})
    drive = opened(node)
    with pytest.raises(DriveError, match=r"6040h be mapped into its receive PDO 1600h: .* \(abort code 06010002h\); .*nothing was moved"):
        able(drive, "torque")
    assert node.state == 0x40


def test_a_speed_that_cannot_be_mapped_is_the_change_of_the_position(opened):
    node = FixedMapping()
    node.unmappable = (0x606C,)
    drive = able(opened(node), "torque")
    assert "606Ch" in drive.capabilities.cautions[0]
    rows: list[tuple[float, ...]] = []
    drive.record(torque([0.2] * 60), LIMITS, rows.append)
    (t0, *_), (t1, *_) = rows[20], rows[40]
    assert rows[41][4] == pytest.approx((rows[41][3] - rows[40][3]) / (rows[41][0] - rows[40][0]), abs=2 / COUNTS_PER_RAD / 1e-3)
    assert rows[40][4] - rows[20][4] == pytest.approx(0.2 / 1e-3 * (t1 - t0), rel=0.1)


def test_short_pdos_are_enough(opened):
    node = FixedMapping(objects=objects_with_four())
    node.most = 6
    drive = able(opened(node), "torque")
    assert drive.capabilities.cautions == ()
    rows: list[tuple[float, ...]] = []
    drive.record(torque([0.2] * 60), LIMITS, rows.append)
    assert rows[40][1] == pytest.approx(0.2)
    assert rows[40][4] > rows[20][4] > 0.0
