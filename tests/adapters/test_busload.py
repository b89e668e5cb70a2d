"""The period of the exchange: the table of section 3 of the fact sheet, the choice and its words, and the rules of mapping PDOs."""

from __future__ import annotations

import pytest

from adapters.stub_node import StubBus, StubNode
from beltcomm.drive import open_drive
from beltcomm.errors import UsageError
from beltcomm_adapters.busload import LARGEST_LOAD, _cycle_s, _frame_bits, fullest, plan_exchange
from beltcomm_adapters.canopen import connect
from beltcomm_adapters.exchange import _silence, map_pdo
from beltcomm_adapters.link import Link
from beltcomm_adapters.profiles import load_profile
from beltcomm_adapters.sdo import SdoObjects


def test_bits_of_a_frame():
    assert [_frame_bits(n) for n in (0, 4, 6, 8)] == [55, 95, 115, 135]


@pytest.mark.parametrize(
    ("bitrate", "torque_ms", "more_ms"), [(1_000_000, 0.29, 0.40), (500_000, 0.57, 0.80), (250_000, 1.14, 1.60), (125_000, 2.3, 3.2)]
)
def test_the_table_of_cycle_times(bitrate, torque_ms, more_ms):
    # SYNC + 6040h with 6071h + 6064h with 6077h and 6041h; and 606Ch with 6078h
    assert 1e3 * _cycle_s(bitrate, (4, 8)) == pytest.approx(torque_ms, rel=0.02)
    assert 1e3 * _cycle_s(bitrate, (4, 8, 6)) == pytest.approx(more_ms, rel=0.02)


def test_the_fullest_exchange_follows_from_the_mapping():
    assert fullest(load_profile("cia402"), (8, 9, 10)) == (6, 6, 8, 6)  # 607Ah, 60B1h with 60B2h
    assert fullest(load_profile("cmmp-as"), (3, 4, 7)) == (6, 8, 6)
    assert fullest(load_profile("cmmp-as"), (4,)) == (4, 8, 6)


def test_a_period_that_fits_is_chosen_and_said():
    frames = (6, 6, 8, 6)
    periods = [plan_exchange(rate, frames, 1e-3, 1e-3).period_s for rate in (1_000_000, 500_000, 250_000, 125_000)]
    assert periods == pytest.approx([1e-3, 2e-3, 4e-3, 8e-3])  # 4.28 ms of 125 kbit/s, over 0.6 less 6 % of guarding
    for rate in (1_000_000, 500_000, 250_000, 125_000):
        plan = plan_exchange(rate, frames, 1e-3, 1e-3)
        assert plan.load is not None
        assert plan.load <= LARGEST_LOAD
    assert plan_exchange(500_000, (4, 8), 1e-3, 1e-3).period_s == pytest.approx(1e-3)
    words = plan_exchange(500_000, frames, 1e-3, 1e-3).words
    assert words.startswith("A SYNC every 2 ms: with its frames it takes 1.07 ms of 500 kbit/s")
    assert "1 ms would load it with 109 %, a higher bit rate allows more" in words
    assert plan_exchange(None, frames, 1e-3, 1e-3).period_s == 1e-3
    assert plan_exchange(1_000_000, frames, 6.4e-3, 0.4e-3, 6.9e-3).period_s == pytest.approx(7.2e-3)
    assert plan_exchange(1_000_000, frames, 1e-3, 1e-3, 3e-3).period_s == pytest.approx(3e-3)


@pytest.mark.parametrize(
    ("wanted", "said"), [(0.5e-3, "none below 1 ms"), (-1.0, "positive"), (float("nan"), "positive"), (float("inf"), "positive")]
)
def test_a_period_that_cannot_be_is_refused(wanted, said):
    with pytest.raises(UsageError, match=said):
        plan_exchange(1_000_000, (4, 8), 1e-3, 1e-3, wanted)


def test_a_bus_that_cannot_guard_is_refused():
    with pytest.raises(UsageError, match="signs of life"):
        plan_exchange(10_000, (4, 8), 1e-3, 1e-3)


@pytest.mark.parametrize(("options", "period_ms"), [({"bitrate": 250_000}, 4), ({"sample_period": 0.002}, 2), ({}, 1)])
def test_a_drive_is_opened_with_the_period_that_fits(options, period_ms):
    with open_drive("virtual:g_a", options) as drive:
        assert drive.capabilities.sample_period_s == pytest.approx(period_ms * 1e-3)
        assert f"A SYNC every {period_ms} ms" in drive.capabilities.exchange


class StrictNode(StubNode):
    """Follows CiA 301 to the letter: an identifier and a mapping change only while the PDO is off, remote frames are never allowed."""

    def _sdo(self, data: bytes) -> None:
        index, sub, raw = int.from_bytes(data[1:3], "little"), data[3], int.from_bytes(data[4:8], "little")
        if data[0] & 0xE0 == 0x20 and (index, sub) in self.objects:
            pdo = {0x1400: 0x1400, 0x1600: 0x1400, 0x1800: 0x1800, 0x1A00: 0x1800}.get(index & 0xFE00)
            if pdo is not None:
                place = (pdo + (index & 0x1FF), 1)
                now = int(self.get(*place))
                same = (raw ^ now) & 0x1FFFFFFF == 0
                bad_id = (index, sub) == place and (raw & 1 << 30 == 0 or (not same and not (now & raw) >> 31))
                bad_map = (index, sub) != place and not now >> 31
                bad_entry = index & 0xFE00 in (0x1600, 0x1A00) and sub > 0 and self.get(index, 0) != 0
                if bad_id or bad_map or bad_entry:
                    self._abort(data[1:4], 0x06010000)
                    return
        super()._sdo(data)


def test_a_strict_drive_lets_its_pdos_be_mapped_and_given_back():
    node = StrictNode()
    node.put(0x1400, 1, 0x40000305)  # enabled, with another identifier than the one that is wanted
    node.put(0x1600, 0, 1)
    node.put(0x1600, 1, 0x60400010)
    for number in (2, 3):
        node.objects[0x1800 + number, 1] = ("<I", 0x40000381 + 0x100 * number)  # somebody's event-driven ones
    before = dict(node.objects)
    with StubBus(node) as bus:
        objects = SdoObjects(Link(bus, bus.clock, 1))
        with objects.lend() as lending:
            assert map_pdo(objects, lending, "receive", 0, ((0x6040, 0, 16), (0x6071, 0, 16))) == 0x201
            _silence(objects, lending, "transmit", 2)
            assert node.get(0x1400, 1) == 0x40000201
            assert node.get(0x1802, 1) == 0xC0000581
        assert node.objects == before
        assert all(remote is False for *_, remote in bus.sent)


def test_sdo_transfers_never_overlap():
    """F1 p22: one request at a time; over a whole connection every request is answered before the next."""
    node = StubNode()
    open_requests: list[int] = []

    class Watched(StubBus):
        def send(self, msg, timeout=None):
            if msg.arbitration_id == 0x601:
                assert open_requests == []
                open_requests.append(1)
            super().send(msg, timeout)

        def recv(self, timeout=None):
            frame = super().recv(timeout)
            if frame is not None and frame.arbitration_id == 0x581:
                open_requests.clear()
            return frame

    bus = Watched(node)
    with connect(bus, bus.clock, 1, None, None, bus.shutdown) as drive:
        drive.backup()
    assert len([1 for _, cob, *_ in bus.sent if cob == 0x601]) > 20
