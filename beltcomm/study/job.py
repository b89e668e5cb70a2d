"""``beltcomm study``: the members of a population one by one, wherever they are computed, into a file that a killed study goes on with."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from io import RawIOBase
from pathlib import Path
from typing import Any

from beltcomm import atomic
from beltcomm.axis.terms import pictures_in
from beltcomm.borders import for_json
from beltcomm.caches import source_hash
from beltcomm.configfiles import find_config, to_yaml, write_text
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.given import pasted
from beltcomm.locks import occupied
from beltcomm.outside import MEASURED_BYTES, from_json, read_bytes, read_text
from beltcomm.result import Result, jsonable, plain
from beltcomm.sentences.own_words import lines_in, text_in
from beltcomm.study import words as words
from beltcomm.study.file import Study, load_study
from beltcomm.study.members import Doing, line_of, lines_of
from beltcomm.study.summary import summary_of
from beltcomm.study.workers import answers, processors
from beltcomm.talk import Silence, Talk

#: File of the results, a line of JSON each; of what follows from them, and the page of it; copy of the study.
MEMBERS, SUMMARY, PAGE, COPY = "members.jsonl", "summary.json", "study.html", "study.yaml"
#: Results of runs that a fleet has no more: one that comes back unchanged is not computed again.
GONE = "members-gone.jsonl"
#: What every result of a fleet holds.
FLEET_RESULTS = {"diagnose": "named", "compare": "ratio"}
#: Members that one task computes when they take milliseconds, and tasks that each worker should get at least.
TOGETHER, TASKS = 16, 4

Line = dict[str, Any]


def study_of(
    file: str | Path,
    out: Path,
    *,
    doing: Doing,
    workers: int | None = None,
    scheduler: str | None = None,
    limit: int | None = None,
    report: bool = True,
    talk: Talk | None = None,
) -> Result:
    """All members that have no result in ``out`` yet, then what all of them say.   Exit code 1 where a member misses, or has no result.

    The results are the same
    whoever computes them, bit for bit, on processors of one kind.

    Parameters
    ----------
    file : str or Path
        Of the study.
    out : Path
        Folder of the results.
    doing : Doing
        Commands that a member may need.
    workers : int or None
        Processes, None for one per processor.
    scheduler : str or None
        Address of a Dask cluster in their place.
    limit : int or None
        So many more members at most; with 0 only what is known is said, also while another process computes.
    report : bool
        The page too.
    talk : Talk or None
        Hears progress; None says nothing.

    Raises
    ------
    UsageError
        For a wrong study, a folder of another study or one in which another process computes, a scheduler that cannot be used.
    DataError
        For a damaged folder.
    Refused
        Where workers die or vanish.
    """
    if workers is not None and scheduler is not None:
        raise UsageError("--workers are processes of this machine, --scheduler is a cluster: choose one")
    talk = talk or Silence()
    asked = load_study(file, doing)
    _make(out)
    if limit == 0:
        lines = _goes_on(asked, out, reads_only=True).lines
        _copy(file, out)
        return _result(asked, file, out, lines, report)
    with occupied(
        out,
        talk,
        refusal=lambda holder: (
            f"{out} is being computed by {holder}; wait for its end, or end it and the same command goes on; "
            "--limit 0 reads what is known so far"
        ),
        unwritable="choose another --out",
    ):
        lines = _compute_members(asked, file, out, workers=workers, scheduler=scheduler, limit=limit, talk=talk)
        return _result(asked, file, out, lines, report)


def _compute_members(
    asked: Study, file: str | Path, out: Path, *, workers: int | None, scheduler: str | None, limit: int | None, talk: Talk
) -> dict[int, Line]:
    """All members with a result, old and new."""
    kept = _goes_on(asked, out, reads_only=False)
    lines = dict(kept.lines)
    _copy(file, out)
    if kept.told:
        talk.say(f"runs since the last time: {kept.told}")
    if kept.aside:  # no line leaves one of the two files before it stands in the other
        write_text(out / GONE, "".join(map(_line_text, kept.aside)))
    open_members = [(k, key, asked.values(k)) for k, key in enumerate(kept.keys) if k not in lines][:limit]
    if open_members:
        told = f" ({len(lines)} are done)" if lines else ""
        talk.say(f"{len(open_members)} members to compute{told}; each stands in {out / MEMBERS} when it is done, the same command goes on")
        size = 1 if asked.each != "track" else max(1, min(TOGETHER, len(open_members) // (TASKS * (workers or processors()))))
        tasks = [open_members[k : k + size] for k in range(0, len(open_members), size)]
        talk.phase(1, 1, f"{asked.each} {len(open_members)} members")
        done = 0  # in this session: what was there before says nothing of how long the others take
        _cut(out / MEMBERS)
        with open(atomic.appending(out / MEMBERS), "ab", buffering=0) as members:
            for made in answers(partial(lines_of, asked.work), tasks, workers=workers, scheduler=scheduler, talk=talk):
                if any(line["program"] != source_hash() for line in made):  # a worker that joined later
                    raise Refused("a worker has another beltcomm than this computer; install the same one there. What is done is kept")
                _append(members, "".join(map(_line_text, made)), out / MEMBERS)
                lines |= {line["member"]: line for line in made}
                done += len(made)
                talk.progress(done / len(open_members), None)
    if open_members or kept.told:
        write_text(out / MEMBERS, "".join(_line_text(lines[k]) for k in sorted(lines)))
    if kept.aside:
        write_text(out / GONE, "".join(_line_text(line) for line in kept.aside if _is_gone(line, asked)))
    return lines


def _append(file: RawIOBase, text: str, path: Path) -> None:
    """Lines onto the disk.   Raises UsageError; the last line may be torn then, and is cut off by whoever goes on."""
    data = text.encode()
    try:
        while data:
            data = data[file.write(data) or 0 :]
        os.fsync(file.fileno())
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}; make room, and the same command goes on") from error


def _is_gone(line: Line, asked: Study) -> bool:
    """True if a line is that of a run which the fleet has no more."""
    return line["values"]["run"] not in asked.runs


def one_member(file: str | Path, number: int, *, doing: Doing, out: Path | None) -> Result:
    """One member again, as any worker computes it.

    Parameters
    ----------
    file : str or Path
        Of the study.
    number : int
        Of the member, from 0.
    doing : Doing
        Commands that a member may need.
    out : Path or None
        Folder for its plant file, and for the run of one that is commissioned.

    Raises
    ------
    UsageError
        For a number that the study does not have.
    """
    asked = load_study(file, doing)
    if not 0 <= number < asked.count:
        raise UsageError(f"the study has members 0 to {asked.count - 1}, not {number}")
    values = asked.values(number)
    described, kept = asked.work.described(values), []
    if out is not None and described is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_text(out / "plant.yaml", to_yaml(described))
        kept.append(f"Its plant is in {out / 'plant.yaml'}: beltcomm commission --drive virtual:{pasted(out / 'plant.yaml')} takes it.")
    line = line_of(asked.work, number, asked.key(number), values, out)
    return Result({**line, "plant": described}, [*lines_in(asked.terms, words.member_lines(line, asked)), *kept], line["exit_code"])


def _result(asked: Study, file: str | Path, out: Path, lines: Mapping[int, Line], report: bool) -> Result:
    ordered = [lines[k] for k in sorted(lines)]
    summary = summary_of(ordered, asked.count, asked.targets, asked.nominal)
    data = {"study": asked.name, "each": asked.each, "base": asked.base, "gains": asked.gains, "targets": asked.targets, **plain(summary)}
    write_text(out / SUMMARY, json.dumps(jsonable(data), indent=1, ensure_ascii=False) + "\n")
    made = [MEMBERS, SUMMARY]
    if report:
        from beltcomm.study.page import study_page  # a worker draws nothing

        with pictures_in(asked.terms):
            page = study_page(asked, summary, ordered, f"beltcomm study {pasted(file)}")
        write_text(out / PAGE, _said(asked, page))
        made.append(PAGE)
    missed = summary.failed or any(line["exit_code"] for line in ordered) or summary.done < summary.planned
    text = [*lines_in(asked.terms, words.summary_lines(asked, summary, ordered, str(file))), f"Everything is in {out}: {', '.join(made)}."]
    if summary.done < summary.planned:
        text.append(f"{summary.planned - summary.done} members are still to come: the same command goes on")
    return Result({**data, "folder": str(out), "page": str(out / PAGE) if report else None}, text, int(bool(missed)))


def _said(asked: Study, page: str) -> str:
    """A page in the words of the axis: what stands between its marks, but for styles."""
    head, mark, body = page.partition("</style>")
    return f"{head}{mark}{text_in(asked.terms, body)}" if asked.terms else page


def _make(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out} cannot be made: {error.strerror}; choose another --out") from error


@dataclass(frozen=True)
class KeptResults:
    """Results of a study in a folder.

    Attributes
    ----------
    keys : tuple of str
        Of all members, by number.
    lines : dict of int to Line
        Results that count, by member.
    aside : tuple of Line
        Lines of runs that had gone away from a fleet, then or now, which count when they come back.
    told : str
        What changed, in words.
    """

    keys: tuple[str, ...]
    lines: dict[int, Line]
    aside: tuple[Line, ...] = ()
    told: str = ""


def _goes_on(asked: Study, out: Path, reads_only: bool) -> KeptResults:
    """Raises UsageError for results of another study, and of another program if it goes on."""
    keys, found = tuple(asked.key(k) for k in range(asked.count)), _read_members(out / MEMBERS)
    kept = _of_population(asked, out, keys, found) if asked.population is not None else _of_fleet(asked, out, keys, found)
    for number, line in kept.lines.items():
        if not reads_only and line.get("program") != source_hash():
            raise UsageError(
                f"{out} holds results of another beltcomm (member {number}), which are not mixed with new ones; choose another --out, "
                "or --limit 0 to read what it holds"
            )
    return kept


def _of_population(asked: Study, out: Path, keys: Sequence[str], found: Sequence[Line]) -> KeptResults:
    """A member is its number: whatever else it is now, it is another study."""
    for line in found:
        number = line["member"]
        if number >= asked.count:
            raise UsageError(
                f"{out} holds member {number}, this study has {asked.count}; give the number it was made with, or another --out"
            )
        if line["key"] != keys[number]:
            raise UsageError(f"{out} holds results of another study: {_differs(line, asked)}; choose another --out")
    return KeptResults(tuple(keys), {line["member"]: line for line in found})


def _of_fleet(asked: Study, out: Path, keys: Sequence[str], found: Sequence[Line]) -> KeptResults:
    """A member is its run folder with what that holds: its number is its place among the folders of today."""
    sign = FLEET_RESULTS[asked.each]
    for line in found:
        if "run" not in line["values"] or ("found" in line and sign not in line["found"]):
            raise UsageError(f"{out} holds results of another study: member {line['member']} is no run that {asked.each} was done with; "
                             "choose another --out")  # fmt: skip
    before_it = _read_members(out / GONE)
    by_key = {line["key"]: line for line in [*(line for line in before_it if line.get("program") == source_hash()), *found]}
    lines = {k: {**by_key[key], "member": k} for k, key in enumerate(keys) if key in by_key}
    left = [line for line in found if _is_gone(line, asked)]
    had = {line["values"]["run"] for line in found}
    counts = {
        "changed and computed again": sum(run in had and k not in lines for k, run in enumerate(asked.runs)),
        f"gone and counted no more (their results stay in {GONE})": len({line["values"]["run"] for line in left}),
        "back as they were": sum(line["values"]["run"] not in had for line in lines.values()),
    }
    aside = sorted({line["key"]: line for line in [*before_it, *left]}.values(), key=lambda line: str(line["values"]["run"]))
    return KeptResults(tuple(keys), lines, tuple(aside), ", ".join(f"{count} {words}" for words, count in counts.items() if count))


def _differs(line: Line, asked: Study) -> str:
    now = dict(asked.values(line["member"]))
    for name in dict.fromkeys([*line["values"], *now]):
        before, after = line["values"].get(name, "nothing"), now.get(name, "nothing")
        if before != after:
            return f"member {line['member']} had {name} {before}, now it has {after}"
    return f"member {line['member']} has the same values, but base, design, move or targets differ"


def _read_members(path: Path) -> list[Line]:
    """The lines of a file of members, but for one that is half written; raises DataError for a damaged line."""
    if not path.is_file():
        return []
    data, lines = read_bytes(path, MEASURED_BYTES), []
    for number, text in enumerate(data[: data.rfind(b"\n") + 1].splitlines(), 1):
        try:
            line = from_json(text)
            int(line["member"]), str(line["key"]), dict(line["values"]), int(line["exit_code"])
            if not isinstance(line.get("found"), dict) and "error" not in line:
                raise ValueError("it has neither result nor error")
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            raise DataError(f"{path} is damaged in line {number} ({error}); delete that line, and its member is computed again") from error
        lines.append(line)
    return lines


def _cut(path: Path) -> None:
    """Take away what a killed study left half written."""
    data = read_bytes(path, MEASURED_BYTES) if path.is_file() else b""
    if data and not data.endswith(b"\n"):
        os.truncate(path, data.rfind(b"\n") + 1)


def _line_text(line: Line) -> str:
    """A line of the file of members, which :func:`_read_members` reads."""
    return for_json(jsonable(line)) + "\n"


def _copy(file: str | Path, out: Path) -> None:
    source = find_config("studies", str(file))
    if source.resolve() != (out / COPY).resolve():
        write_text(out / COPY, read_text(source))
