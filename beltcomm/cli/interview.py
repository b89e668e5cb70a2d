"""Questions of ``beltcomm init``, one after the other, and back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beltcomm.axis.answers import in_words, usual, usual_words
from beltcomm.axis.entries import AT, COMMISSION_NEEDS
from beltcomm.cli.questions import Back, Done, ask_number, ask_word, reply, tell, toothed
from beltcomm.errors import UsageError
from beltcomm.language import tr
from beltcomm.quantities import suffix_of

if TYPE_CHECKING:
    from beltcomm.axis import Axis
    from beltcomm.axis.entries import AxisEntry

#: Titles that say more than in the file.
_TITLES = {
    "gearbox": "Gearbox (ratio 1 when there is none)",
    "targets": "Targets of the axis (Enter: the default, 1 mm while it moves and 0.1 mm from 0.5 s on, at the motor)",
}
#: Asked only where another entry of the section has a value.
_ONLY_WITH = {"brake_time_s": "brake_torque_nm"}
#: Belt before position 0, which no travel lets be negative.
_OFFSET = ("travel", "driven_side_offset_m")
_BELT_SECTIONS = ("gearbox", "coupling", "pulley", "belt")


def asked_all(start: Axis, unfinished: Path, kind: str, of: str) -> dict[str, Any]:
    """All entries by questions; a wrong answer is explained and asked again.

    Parameters
    ----------
    start : Axis
        Whose values Enter keeps.
    unfinished : Path
        File of what is known when the questions are broken off.
    kind : str
        Of the axis; "other" for none.
    of : str
        What the start is made of: only what it lacks and what is unusual is asked, the rest is shown and changed by number. "" asks all.

    Returns
    -------
    dict
        As axis.yaml has it.
    """
    from beltcomm.axis.entries import SECTIONS, entries_of
    from beltcomm.axis.kinds import KINDS
    from beltcomm.configfiles import to_yaml, write_text

    data: dict[str, Any] = start.to_dict()
    own = KINDS.get(kind)
    data["name"], question = start.name if of else "", tr("Name of the axis")
    while not data["name"]:
        with suppress(Back, Done):
            data["name"] = reply(question, start.name, back=True)
        question = tr("  Plans and reports need its name")
    if own is not None:
        entries = own.sections()
    else:
        sections = {name: each for name, each in SECTIONS.items() if kind == "belt" or name not in _BELT_SECTIONS}
        entries = {section: entries_of(each) for section, each in sections.items()}
        for section in SECTIONS.keys() - sections.keys():
            data.pop(section, None)
    words = {"motor": ["name"], "targets": ["at"]}
    questions = [(section, name) for section in entries for name in (*words.get(section, []), *entries[section])]
    answers = _Answers(data["name"], kind if own is not None else "", entries)
    interview = _Interview(questions, entries, data, answers)
    try:
        if of:
            interview.keep(of)
        interview.ask()
        interview.change()
    except (KeyboardInterrupt, UsageError):
        if any(value not in (None, "") for value in answers.told.values()):
            for (section, name), value in {**answers.told, **answers.implied}.items():
                data.setdefault(section, {})[name] = value
            write_text(unfinished, to_yaml(data))
            tell(f"\nWhat was answered is kept in {unfinished}; the same command goes on with it.")
        raise
    return {**data, **{section: answers.known.get(section, {}) for section in entries}}


class _Answers:
    """Answers given.   told : by section and name, in the order asked.   implied : what one of them says of others, not asked then."""

    def __init__(self, name: str, kind: str = "", sections: Iterable[str] = ()) -> None:
        self.name, self.kind, self.sections = name, kind, tuple(sections)
        self.told: dict[tuple[str, str], Any] = {}
        self.implied: dict[tuple[str, str], float] = {}
        self._doubted: set[str] = set()

    @property
    def known(self) -> dict[str, Any]:
        """As axis.yaml has it."""
        found: dict[str, Any] = {"name": self.name, **{section: {} for section in self.sections}}  # an empty pulley still is one
        if self.kind:
            found["transmission"] = {"kind": self.kind}
        for (section, name), value in {**self.told, **self.implied}.items():
            if value not in (None, ""):
                found.setdefault(section, {})[name] = value
        return found

    def fault(self, section: str, name: str, value: float | None) -> str:
        """Contradiction between a further answer and those before, "" for none."""
        from beltcomm.axis import axis_from_dict
        from beltcomm.axis.impossible import passing_the_pulley

        known = self.known
        known = {**known, section: {**known.get(section, {}), name: value}}
        low = known.get("travel", {}).get("min_m")
        if (section, name) == _OFFSET and low is not None and not self.kind and (why := passing_the_pulley(low, value or 0.0)):
            return why  # as 0, too, which a file has where nobody stated it
        if (section, name) != _OFFSET and _OFFSET not in self.told and low is not None and not self.kind:
            # asked behind the travel: until then it is as long as the travel needs it
            known["travel"] = {**known["travel"], _OFFSET[1]: max(0.0, -low)}
        try:
            axis_from_dict(known)
        except UsageError as error:
            return str(error)
        return ""

    def new_doubts(self) -> list[str]:
        """Sentences on answers that do not go together and yet can be, those that were not told yet."""
        from beltcomm.axis import axis_from_dict
        from beltcomm.axis.doubtful import doubts
        from beltcomm.axis.impossible import passing_the_pulley
        from beltcomm.axis.terms import terms_of

        try:
            axis = axis_from_dict(self.known)
        except UsageError:
            return []  # before its last answer, as above
        early = "" if _OFFSET in self.told else passing_the_pulley(axis.travel.min_m or 0.0, axis.travel.driven_side_offset_m)
        found = [terms_of(axis).said(text) for text in doubts(axis) if text != early]  # that is asked behind the travel
        new = [text for text in found if text not in self._doubted]
        self._doubted |= {*found}
        return new


class _Interview:
    """Questions one after the other, and back.   start : values that Enter keeps.   kept, unusual : answered by the start."""

    def __init__(
        self,
        questions: Sequence[tuple[str, str]],
        entries: Mapping[str, Mapping[str, AxisEntry]],
        start: Mapping[str, Any],
        answers: _Answers,
    ) -> None:
        from beltcomm.axis.kinds import KINDS

        self.questions, self.entries, self.start, self.answers = questions, entries, start, answers
        self.needs = KINDS[answers.kind].needs if answers.kind in KINDS else COMMISSION_NEEDS
        self.kept: set[tuple[str, str]] = set()
        self.unusual: set[tuple[str, str]] = set()

    def _known(self, section: str, name: str) -> Any:
        return (self.start.get(section) or {}).get(name)

    def keep(self, of: str) -> None:
        """Ask only for what is missing or unusual.   of : where the values are from."""
        for section, name in self.questions:
            value = self._known(section, name)
            if value in (None, ""):
                continue
            as_usual = isinstance(value, str) or usual(f"{section}.{name}", value, self.answers.kind)
            (self.kept if as_usual else self.unusual).add((section, name))
        words = "{of} answers {count} of {all} questions; the others are asked. 'done' leaves out what is not needed."
        tell(tr(words, of=of, count=len(self.kept), all=len(self.questions)))

    def ask(self) -> None:
        """All questions but those that are kept."""
        answers, questions = self.answers, self.questions
        before: dict[tuple[str, str], Any] = {}  # answered before somebody went back
        asked, at, done = list[int](), 0, False
        while at < len(questions):
            section, name = key = questions[at]
            if key in answers.implied or (name in _ONLY_WITH and answers.told.get((section, _ONLY_WITH[name])) is None):
                at += 1
                continue
            known = before.get(key, self._known(section, name))
            settled = key in self.kept and key not in before
            needed = key in self.unusual if known is not None else f"{section}.{name}" in self.needs
            as_it_is = isinstance(known, str) or not (wrong := answers.fault(section, name, known))
            if (settled or (done and not needed)) and as_it_is:
                answers.told[key] = known
                at += 1
                continue
            if not asked or questions[asked[-1]][0] != section:
                tell(f"\n{tr(_title(section, answers.kind))}")
            if not as_it_is and (settled or done):
                tell(f"    {wrong}")
            try:
                self._ask_one(at, known)
            except Done:
                if done and as_it_is:  # said again, of one that is needed
                    answers.told[key] = known
                    at += 1
                done = True
                continue
            except Back:
                at = asked.pop() if asked else 0
                before[questions[at]] = answers.told.pop(questions[at], None)
                continue
            asked.append(at)
            at += 1

    def _ask_one(self, at: int, known: Any) -> None:
        """One question.   at : its number, from 0.   known : what Enter keeps.   Raises Back and Done."""
        answers, (section, name) = self.answers, self.questions[at]
        where = f"[{at + 1}/{len(self.questions)}] "
        if name == "name":
            answers.told[section, name] = reply(where + tr("Type"), known or "", back=True)
        elif name == "at":
            from beltcomm.axis.kinds import KINDS
            from beltcomm.axis.terms import terms

            load = KINDS[answers.kind].load if answers.kind else AT[1]
            question = terms(answers.kind).said(tr("Where targets count: motor, carriage or both"))
            answers.told[section, name] = ask_word(where + question, (AT[0], load, AT[2]), known or "")
        else:
            if known is not None and not usual(f"{section}.{name}", known, answers.kind):
                tell(f"    {in_words(name, known)}: {tr('usual are')} {usual_words(f'{section}.{name}', answers.kind)}")
            fault = partial(answers.fault, section, name)
            entry = self.entries[section][name]
            answers.told[section, name], text = ask_number(f"{section}.{name}", name, entry, known, fault, where, answers.kind)
            if name == "effective_radius_m":
                answers.implied = toothed(text)
            for doubt in answers.new_doubts():
                tell(f"    Note: {doubt}")

    def change(self) -> None:
        """Show what was kept, and ask those again whose number is given."""
        answered = not self.kept
        with suppress(Done):
            while not answered:
                self._show_kept()
                with suppress(Back):
                    answered = not self._changed(reply(tr("A number changes that answer, Enter writes the file"), "", back=True))

    def _show_kept(self) -> None:
        tell("")
        for section in self.entries:
            told = [self._told(at) for at, key in enumerate(self.questions) if key[0] == section and key in self.kept]
            if told:
                tell(f"{tr(_title(section, self.answers.kind)).partition(' (')[0]}: {', '.join(told)}")

    def _changed(self, number: str) -> bool:
        """Ask the question of a number again; False for none."""
        at = int(number) - 1 if number.isdigit() else -1
        if 0 <= at < len(self.questions):
            self._ask_one(at, self.answers.told.get(self.questions[at]))
        elif number:
            tell(f"    {number!r}: 1 ... {len(self.questions)}")
        return bool(number)

    def _told(self, at: int) -> str:
        """Number, key and value of an answer."""
        key = self.questions[at]
        name = key[1]
        value = {**self.answers.told, **self.answers.implied}.get(key)
        said = "-" if value in (None, "") else str(value) if isinstance(value, str) else in_words(name, value)
        return f"[{at + 1}] {label(*key)} {tr(said) if name == 'at' else said}"


def label(section: str, name: str) -> str:
    """A key of axis.yaml in a word or two: the key without its unit, in another language by its place in the file.

    Parameters
    ----------
    section, name : str
        ``motor``, ``rated_torque_nm``.
    """
    stem = name.removesuffix(f"_{suffix_of(name)}") if suffix_of(name) else name
    words, place = stem.replace("_", " "), f"{section}.{stem}"
    said = tr(place)
    return words if said == place else said


def _title(section: str, kind: str) -> str:
    """Of a section, as the kind of axis calls it."""
    from beltcomm.axis.kinds import KINDS
    from beltcomm.axis.terms import terms
    from beltcomm.axis.written import TITLES

    own = KINDS.get(kind)
    if own is not None and section in own.titles:
        return own.titles[section].partition(",")[0]
    title = _TITLES.get(section) or TITLES[section].partition(",")[0]
    return title if own is None else terms(kind).said(title)
