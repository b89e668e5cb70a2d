"""``beltcomm watch``: the model of a run runs along in production; it reads, and nothing moves for it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis.terms import terms_of
from beltcomm.drive import Clock, Drive, Limits, Motion, simulated
from beltcomm.drive.access import listen_to
from beltcomm.drive.parameters import cascade_to_parameters
from beltcomm.errors import BeltcommError, DataError, UsageError
from beltcomm.foreign.convert import Reading
from beltcomm.given import Place, pasted, place
from beltcomm.recording import Recording, Sidecar, recording_from_columns
from beltcomm.result import Line, Result
from beltcomm.rundata import offline
from beltcomm.rundata.fitted_run import explainable, open_fitted
from beltcomm.rundata.proof import limits_of
from beltcomm.rundata.store import saved_design
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import watch as words
from beltcomm.sentences.own_words import lines_in, own_words
from beltcomm.talk import Silence, Talk
from beltcomm.trajectory import plan_trajectory, with_dwell
from beltcomm.verify import REST_S
from beltcomm.watching import store
from beltcomm.watching.drift import AxisDrift
from beltcomm.watching.estimates import ERROR, POOL, MoveEstimate, Standing
from beltcomm.watching.judge import Judge
from beltcomm.watching.limits import LIMITS, limits_given
from beltcomm.watching.moves import StreamPart, moves_in
from beltcomm.watching.places import Untold, untold_by
from beltcomm.watching.streams import BusStream, GrowingLog

#: s between two looks at a log, and for which a bus is listened to at a time.
LOOK_S = 0.5
#: s without anything new after which a log is taken to be ended.
IDLE_S = 10.0
#: Moves between two lines of titles.
TITLES = 20
#: Moves, those that tell nothing among them, after which it is said what they do not show.
SHOWN_BY = 100
#: m: a virtual production stays so far from the ends of the travel; and its default move.
MARGIN_M, WAY_M = 0.02, 0.5


@dataclass(frozen=True)
class WatchedMove:
    """One move, judged.

    Attributes
    ----------
    lines : sequence of str
        For people.
    data : mapping
        For programs.
    """

    lines: Sequence[str]
    data: Mapping[str, Any]


class _Stream(Protocol):
    notes: tuple[str, ...]

    def poll(self) -> list[StreamPart]: ...

    def forget(self, until_s: float) -> None: ...


@dataclass
class _Watch:
    """State of a watch between two moves."""

    judge: Judge
    drift: AxisDrift
    folder: RunFolder
    date_s: Callable[[float], float]
    tell: Callable[[WatchedMove], None]
    hour: Callable[[float], str]
    counted: int = 0
    left_out: int = 0
    why: str = ""
    first_s: float = math.nan
    last_s: float = math.nan
    standings: list[Standing] = field(default_factory=list)
    states: dict[str, str] = field(default_factory=dict)
    alarms: dict[str, str] = field(default_factory=dict)
    noticed: dict[str, int] = field(default_factory=dict)
    last: deque[Recording] = field(default_factory=lambda: deque(maxlen=POOL))
    suspects: list[tuple[str, str, float]] = field(default_factory=list)
    taken_s: float = -math.inf
    known: set[tuple[float, Any]] = field(default_factory=set)
    before: int = 0
    way_m: tuple[float, float] | None = None
    blind_told: bool = False

    @property
    def untold(self) -> Untold:
        """Quantities and stretches that the moves so far do not show; nothing as long as there are few."""
        return untold_by(self.standings, self.way_m) if self.counted + self.left_out >= SHOWN_BY else Untold()


def _silent(_move: WatchedMove) -> None:
    """Nobody hears of it."""


def _time_of_day(date_s: float) -> str:
    """hh:mm:ss of a date, UTC."""
    return str(np.datetime64(round(date_s), "s"))[-8:]


@own_words
def watch(
    run: Place,
    *,
    drive: str | None = None,
    log: Place | None = None,
    reading: Reading | None = None,
    limits: Sequence[str] = (),
    moves: int | None = None,
    until_alarm: bool = False,
    idle_s: float | None = None,
    silent: bool = False,
    anew: bool = False,
    options: Mapping[str, object] | None = None,
    clock: Clock | None = None,
    wall_clock: Callable[[], float] | None = None,
    tell: Callable[[WatchedMove], None] | None = None,
    hour: Callable[[float], str] | None = None,
    talk: Talk | None = None,
) -> Result:
    """Judge each move of production by the model of a run, from a bus that is listened to or from a log that grows; nothing is written.

    Parameters
    ----------
    run : Place
        Run folder, whose model judges; each move is noted in it (``watch/moves.jsonl``).
    drive : str or None
        Bus that is listened to, as for ``--drive``.
    log : Place or None
        File that grows: a log of CAN frames, or a table.
    reading : Reading or None
        How frames or columns are read.
    limits : sequence of str
        ``KEY=+50%``, ``KEY=0.2`` in SI, ``KEY=none``.
    moves : int or None
        Ends after so many.
    until_alarm : bool
        Ends with the first alarm.
    idle_s : float or None, s
        Ends when nothing has come for so long; None is 10 s for a log, never for a drive.
    silent : bool
        Not even asks the drive what its process data mean.
    anew : bool
        After a maintenance: the next moves are the base that changes are held against.
    options : dict of str to object or None
        For the adapter, by name.
    clock : Clock or None
        By which a log is waited for; None does not wait.
    wall_clock : callable or None
        Date and time, s since 1970.
    tell : callable
        Hears each move as it is judged.
    hour : callable
        Time of the day of a date, for people.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        What has changed; exit code 1 after an alarm.

    Raises
    ------
    UsageError
        For neither or both of drive and log, and for limits that are none.
    DataError
        For a stream that cannot be read, and a run without a model that explains its own records.
    """
    if (drive is None) == (log is None):
        raise UsageError("give what is to be watched: --drive for a bus, or --log for a file that grows; one of them")
    if moves is not None and moves < 1:
        raise UsageError(f"--moves is {moves}; give 1 or more")
    folder = RunFolder.open(place(run))
    opened = open_fitted(folder.path, talk or Silence())
    explainable(opened.fitted.ratio, folder.path)
    judge = Judge(opened)
    reference = {**judge.reference, ERROR: MoveEstimate(judge.ratio, 0.0)}
    given, drift = limits_given(limits), AxisDrift(reference, LIMITS, judge.width_m)
    if unknown := sorted(set(given) - set(drift.keys)):
        raise UsageError(f"a move tells nothing of {unknown[0]}; of this axis it tells {', '.join(sorted(drift.keys))}")
    read = reading or Reading()
    drift = AxisDrift(reference, {**LIMITS, **given}, judge.width_m)
    state = _Watch(judge, drift, folder, lambda at_s: at_s, tell or _silent, hour or _time_of_day)
    _resume(state, anew)
    with ExitStack() as stack:
        if log is not None:
            pieces, stream = _of_log(GrowingLog(place(log, "log"), read, judge.axis), clock, IDLE_S if idle_s is None else idle_s, stack)
        else:
            assert drive is not None
            pieces, stream = _of_drive(drive, read, folder, dict(options or {}), silent, idle_s, moves, stack)
        began = None if wall_clock is None else wall_clock()
        zero: list[float] = []

        def date_s(at_s: float) -> float:
            epoch = getattr(stream, "epoch_s", None)
            if epoch is not None:
                return float(epoch) + at_s
            if at_s > 1e9:  # a bus whose interface stamps by the calendar
                return at_s
            zero.append(at_s)
            return (began or 0.0) + at_s - zero[0]

        state.date_s = date_s
        try:
            for ended in pieces:
                _take(state, stream, ended, moves, until_alarm)
                if (moves is not None and state.counted >= moves) or (until_alarm and state.alarms):
                    break
        except KeyboardInterrupt:
            pass
        notes = stream.notes
    if not state.counted and not state.left_out and notes:
        raise DataError(notes[0])
    return _result(state)


def _resume(state: _Watch, anew: bool) -> None:
    """Go on with what was watched before: the base of the first moves, and the last ones."""
    if anew:
        store.append(state.folder.path, {store.ANEW: True})
    for entry in store.entries(state.folder.path, marks=True):
        if store.ANEW in entry:
            state.drift.begin_anew()
            state.standings = []
            continue
        state.standings = state.drift.add_told(store.told_by(entry), store.places_told(entry))
        state.known.add((entry["date_s"], entry.get("error_over_noise")))
        state.before += 1
    state.states = {one.key: one.state for one in state.standings}


def _of_log(log: GrowingLog, clock: Clock | None, idle_s: float, stack: ExitStack) -> tuple[Iterator[bool], _Stream]:
    stack.callback(log.close)

    def pieces() -> Iterator[bool]:
        quiet_s = 0.0
        while True:
            before = log.taken_bytes
            yield False
            if log.taken_bytes > before:
                quiet_s = 0.0
            elif clock is None or quiet_s >= idle_s:
                break
            else:
                clock.sleep_until(clock.now() + LOOK_S)
                quiet_s += LOOK_S
        log.rescan()
        yield True

    return pieces(), log


def _of_drive(
    drive: str,
    reading: Reading,
    folder: RunFolder,
    options: dict[str, object],
    silent: bool,
    idle_s: float | None,
    moves: int | None,
    stack: ExitStack,
) -> tuple[Iterator[bool], _Stream]:
    if simulated(drive):
        options["production"] = _played_production(folder, moves)
    listening = stack.enter_context(listen_to(drive, {**options, "silent": silent}))
    stream = BusStream(listening.title, reading, folder.axis)

    def pieces() -> Iterator[bool]:
        quiet_s, played = 0.0, simulated(drive)
        while True:
            frames = listening.frames(LOOK_S)
            stream.take(frames)
            quiet_s = 0.0 if frames else quiet_s + LOOK_S
            yield False
            if (idle_s is not None and quiet_s > idle_s) or (played and not frames):
                break
        stream.rescan()
        yield True

    return pieces(), stream


def _played_production(folder: RunFolder, moves: int | None) -> Callable[[Drive], Iterator[object]]:
    """The move of the run's verification there and back, with the run's gains: what a virtual drive has in place of a production."""
    axis, saved = folder.axis, saved_design(folder)
    model = offline.design_model(folder, saved)

    def played(drive: Drive) -> Iterator[object]:
        cascade, _ = offline.cascade_of(saved, model, drive.capabilities.structure, None)
        offered = drive.backup()
        drive.write({name: value for name, value in cascade_to_parameters(cascade).items() if name in offered})
        ratio, period = axis.transmission_m_rad, drive.capabilities.sample_period_s
        low, high = _ends(axis)
        room = (low - WAY_M) / ratio, (high + WAY_M) / ratio
        limits = Limits(*room, drive.capabilities.max_speed_rad_s, drive.capabilities.peak_torque_nm)
        here, motion = ratio * drive.read(["position_rad"])["position_rad"], limits_of(folder, period)
        count = 0
        while moves is None or count < moves + 1:
            there = low if here > 0.5 * (low + high) else high
            path = with_dwell(plan_trajectory(here, there, motion, period), REST_S)
            along = np.zeros(len(path.t_s))
            drive.record(Motion("position", period, path.position_m / ratio, path.velocity_m_s / ratio, along), limits, lambda _row: None)
            here, count = there, count + 1
            yield count

    return played


def _ends(axis: Axis) -> tuple[float, float]:
    """Of a virtual production, m."""
    low = 0.0 if axis.travel.min_m is None else max(0.0, axis.travel.min_m + MARGIN_M)
    high = low + WAY_M if axis.travel.max_m is None else min(low + WAY_M, axis.travel.max_m - MARGIN_M)
    return low, high


def _take(state: _Watch, stream: _Stream, ended: bool, most: int | None, until_alarm: bool) -> None:
    """Judge every move that is over by now."""
    passed = state.taken_s
    for stretch in stream.poll():
        found, quiet_s = moves_in(stretch, state.taken_s, ended)
        passed = max(passed, quiet_s)
        for move in found:
            state.taken_s = move.end_s
            _judge_one(state, move.columns, move.start_s)
            if (most is not None and state.counted >= most) or (until_alarm and state.alarms):
                return
    if math.isfinite(passed):
        stream.forget(passed)


def _judge_one(state: _Watch, columns: Mapping[str, Any], start_s: float) -> None:
    number, judge = state.counted + 1, state.judge
    try:
        begins = _begins(state, columns)
        sidecar = Sidecar(experiment="trajectory", closed_loop=True, start_position_m=begins)
        recording = recording_from_columns(f"move_{number}", columns, sidecar, judge.axis, file="the stream")
        judged = judge.judge(recording)
    except DataError as error:
        state.left_out += 1
        state.why = str(error)
        return
    date_s = state.date_s(start_s)
    if (round(date_s, 3), judged.ratio) in state.known:  # of a log that was watched before
        state.left_out += 1
        state.why = "they were judged before"
        return
    state.counted = number
    state.last.append(recording)
    state.standings = state.drift.add(judged)
    state.first_s = date_s if math.isnan(state.first_s) else state.first_s
    state.last_s = date_s + judged.duration_s
    events = _events(state)
    if not state.blind_told and (untold := words.untold_sentence(state.untold)):
        state.blind_told = True
        events.append(("not shown", untold))
    entry = store.entry_of(state.before + number, date_s, judged, state.standings, events)
    store.append(state.folder.path, entry)
    lines: list[str] = [words.head_line(state.standings)] if number % TITLES == 1 else []
    lines.append(words.move_line(state.before + number, state.hour(date_s), judged, state.standings))
    lines += [Line("      ", (f"{kind}: {text}", "bad" if kind == "ALARM" else "note")) for kind, text in events]
    state.tell(WatchedMove(lines_in(terms_of(judge.axis), lines), entry))


def _begins(state: _Watch, columns: Mapping[str, Any]) -> float | None:
    """Carriage position at the start of a move, m, where the run tells it; the way of all moves goes on to this one's ends."""
    if "position_rad" not in columns:
        return None
    position = np.asarray(columns["position_rad"], dtype=np.float64)
    begins, *ends = (state.judge.start_of(float(at)) for at in (position[0], position.min(), position.max()))
    known = [end for end in (*ends, *(state.way_m or ())) if end is not None]
    state.way_m = (min(known), max(known)) if known else None
    return begins


def _events(state: _Watch) -> list[tuple[str, str]]:
    """Changes of state since the move before: kind and sentence."""
    found = []
    for one in state.standings:
        before = state.states.get(one.key, "few")
        state.states[one.key] = one.state
        if one.state == "alarm":  # also one that an earlier watch has raised, as long as it lasts
            state.alarms.setdefault(one.key, words.event_sentence(one).partition(":")[0])
        if one.state == before or (one.state == "steady" and before == "few") or (before == "alarm" and one.state == "changed"):
            continue
        sentence = words.event_sentence(one)
        if one.state != "steady":
            state.noticed.setdefault(one.key, state.counted)
        if one.state != "steady" and one.key == ERROR:
            state.suspects = _suspects(state)
            if state.suspects:
                sentence += f"; by the moves it is most like {' or '.join(name for name, *_ in state.suspects[:2])}"
        found.append(({"alarm": "ALARM", "changed": "noticed", "steady": "back"}[one.state], sentence))
    return found


def _suspects(state: _Watch) -> list[tuple[str, str, float]]:
    try:
        return state.judge.suspects(list(state.last))
    except BeltcommError:
        return []


def _result(state: _Watch) -> Result:
    changed = [words.event_sentence(one).partition(":")[0] for one in state.standings if one.state == "changed"]
    seconds = state.last_s - state.first_s if state.counted else 0.0
    text: list[str] = words.summary_lines(
        state.counted, state.left_out, state.why, seconds, state.standings, list(state.alarms.values()), changed
    )
    run = state.folder.path
    if untold := words.untold_sentence(state.untold):
        text.append(f"  {untold}")
    if state.alarms or changed:
        text.append(
            f"Next: beltcomm identify --drive DRIVE --run NEW   (measure it again; beltcomm trend {pasted(run)} NEW tells what drifts)"
        )
    data = {
        "run": str(run),
        "moves": state.counted,
        "left_out": state.left_out,
        "left_out_because": state.why,
        "alarms": state.alarms,
        "noticed_at_move": state.noticed,
        "suspects": [{"effect": name, "title": title, "evidence": value} for name, title, value in state.suspects],
        "quantities": {
            one.key: {
                "value": store.finite(one.value),
                "interval": store.finite(one.interval),
                "state": one.state,
                "noticed_from": store.finite(one.noticed_from),
            }
            for one in state.standings
        },
        "not_shown": {"quantities": list(state.untold.keys), "travel_m": [list(pair) for pair in state.untold.stretches_m]},
    }
    return Result(data, text, 1 if state.alarms else 0)
