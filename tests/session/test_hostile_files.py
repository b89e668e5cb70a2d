"""Two hundred hostile backups, plans, designs and profiles, drawn: nothing moves, nothing beyond the closed list is written, no traceback.

Whatever a file says, the host's frames are looked at: each of its writes, each word that would turn the stage on.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.configfiles import find_config, read_yaml, sealed, to_yaml, unsealed
from beltcomm.drive.objects import TYPES, is_command, name_of
from beltcomm.errors import BeltcommError
from beltcomm.virtual.bus import Frame
from beltcomm_adapters.canopen import connect
from beltcomm_adapters.locks import ALWAYS
from beltcomm_adapters.profiles import load_profile
from session.bench import Bench

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
CODES = (0, 1, 2, 3, 5)
#: Commands, setpoints, outputs, units, ratings, communication, the maker's own: what a backup has no business with, and what it has.
POOL = (0x6040, 0x6060, 0x6071, 0x607A, 0x60FF, 0x60B1, 0x60B2, 0x60C1, 0x60FE, 0x1010, 0x1011, 0x1016, 0x1017, 0x1400, 0x1600, 0x1A00)
POOL += (0x6075, 0x6076, 0x608F, 0x6091, 0x6092, 0x60F6, 0x6410, 0x2101, 0x5FFF, 0x6072, 0x6080, 0x6085, 0x6065, 0x607D, 0x6098, 0x605A)
ODD: tuple[Any, ...] = (float("nan"), float("inf"), 1e308, -1e308, 10**400, 2**64, -1, 0, True, None, "x", "", [], {}, [1.0], "9" * 400)
#: Words of 6040h that leave a stage off: shutdown, disable voltage, quick stop, acknowledging a fault.
OFF = (0x00, 0x02, 0x06, 0x80)


class Eyes:
    """What the host wrote to a bench's drive since :meth:`begin`: objects by SDO, and by PDO nothing at all."""

    def __init__(self, bench: Bench) -> None:
        self.writes: list[tuple[int, int, int]] = []
        self.moving: list[Frame] = []
        bench.log = self._see
        self.bench = bench

    def begin(self) -> None:
        self.writes, self.moving = [], []

    def _see(self, frame: Frame) -> None:
        _, cob, data, sender = frame[:4]
        if sender != "host":
            return
        if cob == 0x601 and len(data) == 8 and data[0] & 0xE0 == 0x20:
            index, subindex, value = struct.unpack_from("<HBI", bytes(data), 1)
            self.writes.append((index, subindex, value))
        elif cob in (0x201, 0x301, 0x401, 0x501):
            self.moving.append(frame)

    def check(self, allowed: set[tuple[int, int]], what: object) -> None:
        beyond = [
            (name_of(index, subindex), value)
            for index, subindex, value in self.writes
            if (index, subindex) not in allowed and not (index == 0x6040 and value & 0x8F in OFF)
        ]
        assert not beyond, what
        assert not self.moving, what
        assert self.bench.plant.cart_position_m == 0.0, what
        assert self.bench.plant.velocity_rad_s == 0.0, what


def said(outcome: Any, what: object) -> None:
    """An exit code of the documented ones, and a sentence; no traceback."""
    assert outcome.exit_code in CODES, (what, outcome.output)
    assert outcome.exception is None or isinstance(outcome.exception, SystemExit), (what, outcome.exception)
    assert "unexpected error" not in outcome.stderr, (what, outcome.stderr)
    assert "Traceback" not in outcome.output, what


def call(*words: object) -> Any:
    return CliRunner().invoke(cli, [str(word) for word in words], input="")


def placed(value: Any, draw: np.random.Generator) -> Any:
    """A nested value with one of its leaves exchanged for something odd."""
    if isinstance(value, (dict, list)) and value and draw.random() < 0.9:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        key = keys[int(draw.integers(len(keys)))]
        value[key] = placed(value[key], draw)
        return value
    return ODD[int(draw.integers(len(ODD)))]


def written(path: Path, data: Any, draw: np.random.Generator) -> None:
    """As the tool writes it, by one who knows the checksum; or edited without."""
    path.write_text(to_yaml(sealed(data) if draw.random() < 0.7 else data), encoding="utf-8")


@pytest.fixture
def eyes(make_bench: MakeBench) -> Eyes:
    bench = make_bench()
    bench.settings()
    return Eyes(bench)


def listed(bench: Bench) -> set[tuple[int, int]]:
    """The closed list, read from the drive by its adapter."""
    with bench.open(bench.name) as drive:
        return {item.place for item in drive.objects() if not is_command(*item.place)}


def mapped(bench: Bench, mapping: set[tuple[int, int]]) -> dict[tuple[int, int], float]:
    """What the drive's PDOs carry, read past the host."""
    there = bench._bus._nodes[0]._dictionary
    return {place: there.entry(*place).value for place in sorted(mapping) if there.has(*place)}


def test_backups(eyes: Eyes, copy_of_complete: Copy) -> None:
    draw, run = np.random.default_rng(37), copy_of_complete()
    path, allowed, codes = run / "results" / "backup.yaml", listed(eyes.bench), set()
    original = unsealed(read_yaml(path))[0]
    kinds = list(TYPES)
    for number in range(70):
        saved = {**original, "objects": [dict(one) for one in original["objects"]]}
        for _ in range(int(draw.integers(1, 8))):
            kind, index = kinds[int(draw.integers(len(kinds)))], POOL[int(draw.integers(len(POOL)))]
            raw = float(draw.choice([0, 1, 3, 7, 15, 127, 65535, 1e9, -1, float(draw.integers(0, 2**31))]))
            entry = {"object": name_of(index, int(draw.integers(3))), "type": kind, "raw": raw}
            saved["objects"].insert(int(draw.integers(len(saved["objects"]) + 1)), entry)
        if draw.random() < 0.3:
            saved["objects"] = placed(saved["objects"], draw)
        if draw.random() < 0.2:  # only values of what is on the list
            saved["objects"] = [{**one, "raw": float(draw.choice([0.0, 1.0, 65535.0, 1e30]))} for one in original["objects"]]
        written(path, saved, draw)
        eyes.begin()
        words = ["--force"] if draw.random() < 0.6 else []
        outcome = call("rollback", "--drive", eyes.bench.name, "--run", run, "--yes", *words)
        said(outcome, number)
        codes.add(outcome.exit_code)
        eyes.check(allowed, number)
    assert {1, 3} <= codes
    assert eyes.bench.stands_disabled()


def test_designs(eyes: Eyes, copy_of_complete: Copy) -> None:
    draw, run = np.random.default_rng(38), copy_of_complete()
    path, allowed, codes = run / "designs" / "final.yaml", listed(eyes.bench), set()
    text = path.read_text(encoding="utf-8")
    for number in range(60):
        path.write_text(text, encoding="utf-8")
        saved = unsealed(read_yaml(path))[0]
        for _ in range(int(draw.integers(1, 4))):
            part = ("parameters", "margins", "proof", "remarks", "compensated", "structure")[int(draw.integers(6))]
            saved[part] = placed(saved.get(part), draw)
        if draw.random() < 0.3:
            saved["parameters"] = {**unsealed(read_yaml(path))[0]["parameters"], "kp_nm_s_rad": float(draw.choice([1e2, 1e4, 1e30, 1e300]))}
        written(path, saved, draw)
        eyes.begin()
        words = ["--force"] if draw.random() < 0.7 else []
        outcome = call("apply", "--drive", eyes.bench.name, "--run", run, "--yes", *words)
        said(outcome, (number, saved.get("parameters")))
        codes.add(outcome.exit_code)
        eyes.check(allowed, number)
    assert {1, 3} <= codes


@pytest.mark.examination
@pytest.mark.usefixtures("fitted")
def test_plans(eyes: Eyes, copy_of_complete: Copy) -> None:
    draw, run = np.random.default_rng(39), copy_of_complete()
    path, allowed, codes = run / "results" / "next.yaml", listed(eyes.bench), set()
    mapping = {(first + pdo, part) for first in (0x1400, 0x1600, 0x1800, 0x1A00) for pdo in range(4) for part in range(9)}
    before = mapped(eyes.bench, mapping)
    steps = [
        {"kind": "response", "place": 0.5, "share": 0.4, "seconds": 5.0, "up_to_hz": 0.0, "held_out": False},
        {"kind": "strokes", "place": 0.4, "speeds_m_s": [0.02, 0.06], "held_out": True},
        {"kind": "reversals", "place": 0.5, "amplitudes_m": [2e-3, 1e-3], "held_out": False},
        {"kind": "moves", "share": 1.0, "seconds": 60.0, "seed": 2, "held_out": False},
    ]
    for number in range(30):
        chosen = [{**steps[int(draw.integers(4))]} for _ in range(int(draw.integers(1, 5)))]
        plan: dict[str, Any] = {"reasons": {"belt": "because"}, "by_hand": [], "steps": chosen, "left_out": []}
        how = draw.random()
        if how < 0.1:  # nothing is wrong with it but that it takes an hour
            plan["steps"] = [steps[3]] * 60
            path.write_text(to_yaml(sealed(plan)), encoding="utf-8")
        elif how < 0.2:  # nobody's
            path.write_text(to_yaml(plan), encoding="utf-8")
        else:
            one = plan["steps"][int(draw.integers(len(chosen)))]
            key = list(one)[int(draw.integers(len(one)))]
            one[key] = ODD[int(draw.integers(6))] if key != "held_out" else "x"
            path.write_text(to_yaml(sealed(plan)), encoding="utf-8")
        eyes.begin()
        outcome = call("identify", "--drive", eyes.bench.name, "--run", run, "--plan", path, "--yes")
        said(outcome, (number, plan))
        assert outcome.exit_code in (1, 2), (number, plan)
        codes.add(outcome.exit_code)
        if outcome.exit_code == 2:  # nothing was read but the plan
            assert eyes.writes == [], (number, plan)
        eyes.check(allowed | mapping, number)
        assert mapped(eyes.bench, mapping) == before, (number, "the mapping that is tried before a motion is put back")
    assert codes == {1, 2}


def test_profiles(make_bench: MakeBench, tmp_path: Path) -> None:
    """What a stranger's profile makes beltcomm write when a drive is opened by it, and its gains are."""
    bench = make_bench(profile="cmmp-as")
    bench.settings()
    eyes, draw, refused = Eyes(bench), np.random.default_rng(40), 0
    path, original = tmp_path / "cmmp-as.yaml", read_yaml(find_config("drives", "cmmp-as"))
    own = {(one["index"], one["subindex"]) for one in original["parameters"].values()}
    lent = {(0x6510, 0x10), (0x6094, 1), (0x6094, 2)}
    for number in range(60):
        profile = read_yaml(find_config("drives", "cmmp-as"))
        part = ("parameters", "parameters", "enable_logic", "modes", "sync", "structure", "referenced", "signals")[int(draw.integers(8))]
        if part == "parameters":
            names = list(profile["parameters"])
            entry = profile["parameters"][names[int(draw.integers(len(names)))]]
            entry |= {"index": POOL[int(draw.integers(len(POOL)))], "subindex": int(draw.integers(3))}
        elif part == "enable_logic":
            profile[part] = {"index": POOL[int(draw.integers(len(POOL)))], "subindex": 0, "type": "int32", "value": 15}
        elif part == "modes":
            profile[part]["torque"] = int(draw.integers(-1, 12))
        else:
            profile[part] = placed(profile[part], draw)
        profile["gain_meaning"] = "documented"
        path.write_text(to_yaml(profile), encoding="utf-8")
        load_profile.cache_clear()
        eyes.begin()
        try:
            with connect(bench._bus, bench._bus.clock, 1, str(path), None, lambda: None) as drive:
                drive.write({name: value for name, value in drive.backup().items() if np.isfinite(value)})
                places = {(one.index, one.subindex) for one in drive.capabilities.parameters.values()}
                assert not [place for place in places if is_command(*place) or any(lock.holds(*place) for lock in ALWAYS)], number
        except BeltcommError:
            refused += 1
        eyes.check(own | lent | {(0x2101, 0), (0x2101, 1), (0x2101, 2), (0x5FFF, 0), (0x6072, 0), (0x6080, 0)}, (number, part))
    load_profile.cache_clear()
    assert refused > 30
