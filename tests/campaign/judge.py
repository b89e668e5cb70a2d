"""A case run and judged: what the machine did, what was left in drive and folder, what was said."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from beltcomm.axis import load_axis
from beltcomm.errors import BeltcommError
from beltcomm.runfolder import RunFolder
from beltcomm.simulate.stopping import first_deceleration
from beltcomm.virtual.stage import EMMS_AS_70
from campaign.cases import COMMANDS, RECORDING, REWRITTEN, Case, standing_s
from campaign.disk import Disk
from campaign.rig import STANDING_M_S, START_M, TICK_S, Outcome, Rig, variant_of

AXIS = "egc-70-600"
TRAVEL_M = (-0.01, 0.57)
#: Of the plant g_a: motor and carriage at the carriage, kg; Coulomb friction of both, N (configs/plants/g_a.yaml).
MASS_KG = 13.44 + 7.173e-5 / 0.01242**2
FRICTION_N = 0.125 / 0.01242
#: Until the drive brakes: periods of a living host that misses three answers, notices one period later, and is heard one more later, and
#: s beside them for the sampling and the delay of the torque; s of a dead one, which the drive's guarding misses after 50 ms.
ALIVE_PERIODS, BESIDE_S, DEAD_S = 5, 0.003, 0.055
#: N: largest force of any setpoint, 1.24 N m at the pulley of axis.yaml.
FORCE_N = 1.24 / 0.01242


@dataclass(frozen=True)
class Verdict:
    """failures : in words, none when the case was survived.   stop_m, stop_s : way and time from the fault to standstill, None without."""

    case: Case
    code: int | None
    sentence: str
    failures: tuple[str, ...]
    stop_m: float | None
    stop_s: float | None
    text: str


_BUS = r"answer|SYNC|[Ff]rames|CAN interface|silent|guard|PDO|bytes|gap|lost|cut off|rows"
_STOPPED = r"move|stuck|hit|clear|brake|off its reference|following|8611h|belt|inertia|friction|speed|torque|position|stand|hold"
#: kind -> exit codes that are right beside the healthy one, what a true sentence of a failure names (CODE is the case's EMCY), and what
#: none may say: another cause.
RIGHT: Mapping[str, tuple[tuple[int, ...], str, str]] = {
    "frames lost": ((1, 3, 4, 5), _BUS, r"8[3-6]\d\dh|overtemp"),
    "frames late": ((1, 3, 4, 5), _BUS, r"8[3-6]\d\dh|overtemp"),
    "frames doubled": ((1, 3, 4, 5), _BUS, r"8[3-6]\d\dh|overtemp"),
    "frames reordered": ((1, 3, 4, 5), _BUS, r"8[3-6]\d\dh|overtemp"),
    "bus-off": ((4, 5), r"CAN interface|answer|silent|got lost", r"error (?!8130h)|restarted"),
    "cable pulled": ((4, 5), r"CAN interface|answer|silent|got lost", r"error (?!8130h)|restarted"),
    "node reset": ((5,), r"restarted", r"cabling|error \d"),
    "EMCY": ((5,), r"CODE", r"restarted|cabling"),
    "SDO abort": ((1, 2, 3, 5), r"refused|abort", r"cable|restarted"),
    "SDO time-out": ((5,), r"answer", r"refused|restarted|went into fault"),
    "wrong scaling": ((1, 2), r"rated.torque", r"cable|cannot be written"),
    "feed constant doubled": ((1, 2, 5), r"units_per_turn|6092h|6093h|inertia", r"CAN interface|cannot be written"),
    "sign inverted": ((1, 4, 5), r"polarity|encoder|off its reference|speed|8400h|8611h", r"CAN interface|cannot be written"),
    "encoder step": ((1, 3, 4, 5), r"encoder|jump|position|speed|8400h|8611h|8612h|off its reference", r"CAN interface|cannot be written"),
    "axis stuck": ((1, 3, 4, 5), _STOPPED, r"CAN interface|cannot be written"),
    "following error": ((1, 3, 4, 5), _STOPPED, r"CAN interface|cannot be written"),
    "end switch": ((5,), r"8081h|8082h", r"CAN interface|restarted"),
    "over-temperature": ((5,), r"4310h", r"CAN interface|restarted"),
    REWRITTEN: ((1, 3, 4, 5), _STOPPED + r"|mode|6061h|predicted", r"CAN interface|cannot be written"),
    "host killed": ((), r"", r"."),
    "clock jump": ((3, 5), r"clock|silent|time", r"restarted|cable"),
    "disk full": ((2,), r"No space left on device.*make room", r"CAN interface|restarted"),
    "folder read-only": ((2,), r"Read-only file system", r"CAN interface|restarted"),
}


def run_case(case: Case, prepared: Path | None, gains: float = 1.25) -> Verdict:
    """Run a case in a folder of its own.   prepared : a finished run of this profile.   gains : that the drive had then, see Rig."""
    with tempfile.TemporaryDirectory(prefix="campaign-") as place:
        run = Path(place) / "run"
        lay_out(case.command, prepared, run)
        rig = Rig(case.profile, gains=gains)
        try:
            return _judged(case, rig, run)
        finally:
            rig.close()


def lay_out(command: str, prepared: Path | None, run: Path) -> None:
    """The run folder that a command begins with."""
    if command in ("move", "identify"):
        return
    assert prepared is not None
    shutil.copytree(prepared, run)
    for name in {"commission": ("sweep", "move_1")}.get(command, ()):
        for file in (run / "recordings").glob(f"{name}.*"):
            file.unlink()
    if command == "friction":
        for file in (run / "recordings").glob("sweep.*"):
            file.unlink()


def words_of(command: str, run: Path, profile: str = "reference") -> tuple[str, ...]:
    """The words of a command line; to a drive of another maker, which has not searched its zero, one says where the carriage stands."""
    words = tuple(str(run) if word == "RUN" else word for word in COMMANDS[command])
    stands = "as" in variant_of(profile)[0] and command in RECORDING
    return (*words, "--position", f"{1e3 * START_M:.0f}mm") if stands else words


def _judged(case: Case, rig: Rig, run: Path) -> Verdict:
    begun = rig.bus.tick
    rig.spoil(case.faults, case.bus_faults)
    disk = Disk(run, *case.disk) if case.disk is not None else None
    outcome = rig.call(*words_of(case.command, run, case.profile), disk=disk)
    ended = len(rig.examiner.place_m)
    rig.run_on(3.0)
    failures = [*_ended(case, outcome, run, rig), *_at_rest(rig), *_left(case, rig, run, outcome), *_readable(run)]
    first = len(rig.examiner.place_m) - (rig.bus.tick - begun - round(case.at_s * 1e3)) - 1
    stop_m, stop_s = _stop(case, rig, first, ended, outcome)
    failures += _bounds(case, rig, run, first, stop_m)
    return Verdict(case, outcome.code, _sentence(outcome.text), tuple(failures), stop_m, stop_s, outcome.text + outcome.error)


def _sentence(text: str) -> str:
    said = [line for line in text.splitlines() if line.startswith("beltcomm: ")]
    return said[-1].removeprefix("beltcomm: ") if said else ""


#: What tells that a drive is virtual (1009h).  One that does not tell is hardware: that its first motion is asked for is the right end.
TELLS_VIRTUAL = (0x1009, 0)
FIRST_MOTION = "--first-motion-confirmed"
#: m: what a drive's belt and a creep's first torque do not do.
UNMOVED_M = 2e-5


def _ended(case: Case, outcome: Outcome, run: Path, rig: Rig) -> list[str]:
    """How the command ended, and what it said."""
    if case.kind == "host killed" and outcome.code is None:
        return [] if outcome.error == "HostDied" else [f"the dead host ended with {outcome.error}"]
    if outcome.code is None:
        return [f"no end: {outcome.error}"]
    wrong = []
    if re.search(r"Traceback|unexpected error|Errno", outcome.text) or list(run.glob("beltcomm-error*")):
        wrong.append("an error that nobody thought of")
    codes, true, false = RIGHT[case.kind]
    true = true.replace("CODE", f"{case.faults.get('emergency_code', 0):04X}h")
    if outcome.code not in (case.normal, *codes):
        wrong.append(f"exit code {outcome.code}, right are {case.normal} and {codes}")
    if case.kind in ALWAYS and outcome.code == case.normal and not re.search(OTHER_UNIT, outcome.text):
        wrong.append("it was not noticed")
    sentence = _sentence(outcome.text)
    refused = [rig.examiner.asked[number - 1] for number in case.faults.get("sdo_abort", ()) if number <= rig.examiner.begun]
    if TELLS_VIRTUAL in refused:
        true += "|" + FIRST_MOTION
    if "nothing was moved" in sentence and float(np.ptp(rig.examiner.place_m)) > UNMOVED_M:
        wrong.append("the sentence says that nothing was moved, and it was")
    if outcome.code not in (0, 1) and not sentence:
        wrong.append("no sentence")
    undisturbed = outcome.code == case.normal and case.kind not in ALWAYS  # it then says what it says when nothing is wrong
    if sentence and not undisturbed and not re.search(true, sentence):
        wrong.append("the sentence does not name the cause")
    if sentence and re.search(false, sentence):
        wrong.append("the sentence names another cause")
    if sentence and not re.search(REMEDY, sentence):
        wrong.append("the sentence does not say what to do next")
    return wrong


#: Faults that are there from the beginning and must not pass.
OTHER_UNIT = r"6076h = \d+ is .* if it counts in cN m"  # a tenth of the rated torque is this, and torques are scaled rightly
ALWAYS = ("wrong scaling", "feed constant doubled", "sign inverted")
REMEDY = (
    r"\b(check|choose|set|remove|plug|repeat|switch|make room|look|identify again|give|correct|enter|begin|bring|shorten|reduce|record|"
    r"use|design|wait|move|leave|finish|secure|run|go on|write)\b|--\w+|`beltcomm"
)


def _at_rest(rig: Rig) -> list[str]:
    wrong = []
    fastest = float(np.abs(rig.examiner.speed_m_s[-50:]).max())
    if fastest >= STANDING_M_S:
        wrong.append(f"the carriage moves with {1e3 * fastest:.1f} mm/s in the end")
    if rig.examiner.powered[-1]:
        wrong.append(f"the stage is on in the end ({rig.device.state.name})")
    return wrong


def _left(case: Case, rig: Rig, run: Path, outcome: Outcome) -> list[str]:
    """Settings of the drive; of one that could not be reached those of the backup, after the repair."""
    kept = case.command in ("apply", "rollback") and outcome.code == 0
    if not case.dead or not rig.changed():
        if kept or (case.command == "move" and case.kind == "node reset"):  # nothing was written, what was not saved is gone
            return []
        foreign = {f"{index:04X}h:{subindex:X}" for index, subindex in case.faults.get("rewritten", ())}
        changed = {name: both for name, both in rig.changed().items() if name not in foreign}
        return [f"not restored: {changed}"] if changed else []
    if case.command == "move":
        return []  # it keeps no folder; what it lends is over with the next power-on
    said = outcome.text
    if outcome.code is not None and not re.search(r"rollback|switch the drive off and on|backup", said):
        return ["settings are lost, and the text names no backup"]
    if not (run / "results" / "backup.yaml").is_file():
        return ["settings are lost, and there is no backup"]
    rig.repair()
    again = rig.call("rollback", "--drive", "virtual", "--run", run, "--yes")
    if again.code != 0:
        return [f"rollback ends with {again.code}: {_sentence(again.text)}"]
    with rig.connected():
        drive = rig.open("virtual")
        now = drive.backup()
        drive.close()
    wrong = {name: (old, now[name]) for name, old in rig.gains.items() if not np.isclose(now[name], old, rtol=1e-6)}
    return [f"the backup does not bring back {wrong}"] if wrong else []


def _readable(run: Path) -> list[str]:
    """Recordings are complete, or marked as unfinished and readable up to their last row."""
    if not (run / "recordings").is_dir():
        return []
    wrong = []
    try:
        folder = RunFolder.open(run)
        names = folder.finished_names()
    except BeltcommError as error:
        return [f"the run folder cannot be read: {error}"]
    for name in names:
        try:
            folder.recording(name)
        except BeltcommError as error:
            wrong.append(f"the finished record {name} cannot be read: {error}")
    for part in (run / "recordings").glob("*.part"):
        lines = part.read_text(encoding="utf-8").splitlines()
        if any(len(line.split(",")) != len(lines[0].split(",")) for line in lines[:-1]):
            wrong.append(f"{part.name} is torn inside")
        note = part.with_name(part.name.replace(".csv.part", ".yaml"))
        if note.is_file() and "finished: true" in note.read_text(encoding="utf-8") and "withdraw" not in part.name and lines[1:]:
            wrong.append(f"{part.name} is marked as finished")
    return wrong


def _stop(case: Case, rig: Rig, first: int, ended: int, outcome: Outcome) -> tuple[float | None, float | None]:
    """Way and time from the fault to standstill, where it came in motion and ended it."""
    place, speed = np.array(rig.examiner.place_m), np.array(rig.examiner.speed_m_s)
    if outcome.code in (0, 1) or not 0 < first < ended or abs(speed[first]) < STANDING_M_S or not _sudden(case):
        return None, None
    stop_s = standing_s(speed, first, STANDING_M_S)
    last = len(place) if np.isinf(stop_s) else first + round(stop_s * 1e3) + 1
    return float(np.abs(place[first:last] - place[first]).max()), stop_s


def _sudden(case: Case) -> bool:
    """Whether the fault comes at once, and ends the motion."""
    ends = ("bus-off", "cable pulled", "node reset", "EMCY", "end switch", "host killed")
    return case.kind in ends and "message only" not in case.about and " ms" not in case.about


def predicted_m(case: Case, run: Path, speed_m_s: float) -> float:
    """The run-on that is counted with at a speed, m: until somebody brakes the torque goes on, then the axis brakes as the session says.

    A fault that takes the stage off leaves the axis to its friction: v²/2a, a = F/m; one that takes a share of the torque takes that of
    the braking.
    """
    period_s = variant_of(case.profile)[1] or TICK_S
    lag_s = DEAD_S + period_s - TICK_S if case.dead else ALIVE_PERIODS * period_s + BESIDE_S
    fastest = abs(speed_m_s) + FORCE_N / MASS_KG * lag_s
    brakes = FRICTION_N / MASS_KG
    if case.kind != "node reset" and "stage off" not in case.about:
        said = re.findall(r"a stop brakes with ([\d.e+-]+) m/s² after ([\d.]+) ms", _journal(run))
        brakes = float(said[-1][0]) if said else first_deceleration(load_axis(AXIS), EMMS_AS_70.peak_torque_nm).value_m_s2
        lag_s += 1e-3 * float(said[-1][1]) if said else 0.0
    if case.kind == "following error":
        brakes = FRICTION_N / MASS_KG + float(case.faults["weak_share"]) * brakes
    return fastest * lag_s + fastest**2 / (2.0 * brakes)


def _journal(run: Path) -> str:
    path = run / "journal.txt"
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _bounds(case: Case, rig: Rig, run: Path, first: int, stop_m: float | None) -> list[str]:
    """The carriage stayed in its travel, but for the run-on; a stop is no longer than that."""
    place, speed = np.array(rig.examiner.place_m), np.array(rig.examiner.speed_m_s)
    allowed = predicted_m(case, run, float(speed[first]) if 0 < first < len(speed) else 0.0)
    wrong = []
    outside = max(TRAVEL_M[0] - float(place.min()), float(place.max()) - TRAVEL_M[1])
    if outside > (allowed if _sudden(case) or case.kind == "following error" else 0.0):
        wrong.append(f"the carriage was {1e3 * outside:.1f} mm outside its travel")
    if stop_m is not None and stop_m > allowed:
        wrong.append(f"it went on for {1e3 * stop_m:.1f} mm, predicted are {1e3 * allowed:.1f} mm from {speed[first]:.3f} m/s")
    return wrong
