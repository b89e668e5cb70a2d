"""The table of the known-truth examination: confusion matrix, and every share with its 95 % interval (Clopper, Pearson)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from scipy.stats import binomtest

#: Names that no motion of the axis can tell apart count as one; what the tool calls them.
FAMILY = {"tilt": "constant_offset", "coulomb_asymmetry": "constant_offset"}

Line = dict[str, Any]

#: What the draws are parted by: whether the instruments of a line have it.
INSTRUMENTS: dict[str, Callable[[Line], bool]] = {
    "setpoint filter": lambda one: "setpoint_alpha" in one or "setpoint_filter_s" in one,
    "current loop": lambda one: "loop_order" in one,
    "slew, steps, inner cycle": lambda one: bool({"slew_nm_s", "setpoint_step", "inner_phase", "delay_samples"} & set(one)),
    "process torque": lambda one: "process_share" in one,
    "reading filtered or late": lambda one: bool({"reading_filter_s", "reading_late"} & set(one)),
    "reading in steps": lambda one: "reading_step" in one,
    "command only": lambda one: "command_only" in one,
    "noise coloured": lambda one: "noise_colour" in one,
    "encoder interpolated": lambda one: "lines_per_rev" in one,
    "encoder below 4000": lambda one: one["counts_per_rev"] < 4000,
    "time jitter": lambda one: "stamp_jitter" in one or "sampling_jitter" in one,
    "no setpoint": lambda one: "setpoint_column" in one,
    "2 ms and slower": lambda one: one["period_s"] > 1.5e-3,
}

#: An effect of the catalogue that drawn instruments may have of themselves.
INTERPOLATION = "encoder_interpolation"


def table(lines: Sequence[Line]) -> None:
    """Everything that the lines of all sets say."""
    sets = {name: [line for line in lines if line["set"] == name] for name in dict.fromkeys(line["set"] for line in lines)}
    for line in lines:
        line["named"] = next(iter(line.get("added", [])), "")
        line["wanted"] = [FAMILY.get(name, name) for name in line["hidden"]]
    known = [line for name in ("effects", "weak") for line in sets.get(name, [])]
    print_confusion(known)
    shown = [line for line in known if line["visible"]]
    print(f"not visible by physics, marked before the diagnosis and left out: {len(known) - len(shown)}")
    print_named("strength 0.4 to 1.0", [line for line in shown if line["strength"] >= 0.4])
    print_named("strength 0.1 to 1.0", shown)
    if healthy := sets.get("healthy"):
        print(f"healthy: false alarms {share(bool(line['named']) for line in healthy)}")
        print(f"    said 'nothing missing' {share(line['verdict'] == 'nothing missing' for line in healthy)}")
        print_ratios("    read", healthy, 0, 0.03)
    if outside := sets.get("outside"):
        print(f"outside the catalogue, called explained: {share(line['verdict'] == 'explained' for line in outside)}")
        for name in dict.fromkeys(line["hidden"][0] for line in outside):
            print(f"    {name:18} {dict(Counter(line['verdict'] for line in outside if line['hidden'] == [name]))}")
    for name in ("instruments", "rigid", "process"):
        if own := sets.get(name):
            print_healthy(name, own)
    if with_instruments := [line for name in ("effects_instruments", "effects_process") for line in sets.get(name, [])]:
        print("with drawn instruments:")
        print_confusion(with_instruments)
        print_named("with drawn instruments, strength 0.4 to 1.0", [line for line in with_instruments if line["visible"]])
    if beyond := sets.get("outside_instruments"):
        print(
            f"outside the catalogue, with drawn instruments, called explained: {share(line['verdict'] == 'explained' for line in beyond)}"
        )
    for name in ("pairs", "backlash"):
        both = [line for line in sets.get(name, []) if len(line["visible"]) == 2]
        if both:
            print(f"{name}: both named {share(set(line['wanted']) <= {FAMILY.get(k, k) for k in line.get('kept', [])} for line in both)}")
            print(f"    one of them first {share(line['named'] in line['wanted'] for line in both)}")
    one = [line for line in shown if right(line)]
    if one:
        print_ratios("after adding the right effect: fitted", one, 1, 0.05)
        print_records(one)
    print_held("held-out error within 1.02 of the true model class", [line for line in shown if line.get("best_held")])
    print_coverage(lines)
    refused = [line for line in lines if "added" not in line]
    print(f"refused, each counted as a failure: {len(refused)} {Counter(line['verdict'][:60] for line in refused) if refused else ''}")
    print(f"remarks on the records: {Counter(text.split(': ')[-1][:60] for line in lines for text in line.get('remarks', []))}")
    print_cost(lines)


def has_interpolation(line: Line) -> bool:
    """True if the drawn encoder errs within its lines, which is an effect of the catalogue."""
    return bool(line["instruments"].get("once_rad"))


def falsely_named(line: Line) -> bool:
    """True if an effect was named that neither machine nor encoder has."""
    return bool(line["named"]) and not (line["named"] == INTERPOLATION and has_interpolation(line))


def print_healthy(name: str, lines: Sequence[Line]) -> None:
    """Healthy machines with drawn instruments: false names, verdicts, ratio, and the parameters against the truth.

    A draw that was refused or crashed has no name, no ratio within and is none of the two verdicts.
    """
    names = Counter(line["named"] for line in lines if line["named"])
    print(f"{name}: false names {share(map(falsely_named, lines))}  named {dict(names)}")
    interpolated = [line for line in lines if has_interpolation(line)]
    print(f"    the encoder's interpolation named where it has one {share(line['named'] == INTERPOLATION for line in interpolated)}")
    for verdict in ("nothing missing", "cannot tell"):
        print(f"    said '{verdict}' {share(line['verdict'].startswith(verdict) for line in lines)}")
    print(f"    other verdicts {dict(Counter(line['verdict'][:60] for line in lines if line['verdict'] != 'nothing missing'))}")
    print(f"    ratio within 1.00 ± 0.05 {share(abs(line.get('ratio', (9.0, 9.0))[1] - 1.0) <= 0.05 for line in lines)}")
    for family in dict.fromkeys(line["family"] for line in lines):
        own = [line for line in lines if line["family"] == family]
        print(f"    {family}: false names {share(map(falsely_named, own))}")
    for item, has in INSTRUMENTS.items():
        own = [line for line in lines if has(line["instruments"])]
        print(f"    {item:24} false names {share(map(falsely_named, own))}")
    for parameter in dict.fromkeys(parameter for line in lines for parameter in line.get("base", {})):
        found = [line["base"][parameter] for line in lines if parameter in line.get("base", {})]
        errors = sorted(value / truth - 1.0 for truth, value, _ in found)
        inside = share(abs(value - truth) <= width for truth, value, width in found if width is not None)
        print(f"    {parameter:26} error {100.0 * errors[len(errors) // 2]:+.3f} % (median), interval holds {inside}")


def right(line: Line) -> bool:
    """Whether the first name is the hidden one."""
    return line["named"] == line["wanted"][0]


def share(events: Iterable[bool]) -> str:
    """k of n, with the interval."""
    found = list(map(bool, events))
    if not found:
        return "none drawn"
    interval = binomtest(sum(found), len(found)).proportion_ci(0.95)
    percent = 100 * sum(found) / len(found)
    return f"{sum(found)} of {len(found)}, {percent:.1f} % ({100 * interval.low:.1f} to {100 * interval.high:.1f} %)"


def print_confusion(lines: Sequence[Line]) -> None:
    """What was named first, by hidden effect."""
    for name in dict.fromkeys(line["hidden"][0] for line in lines):
        own = [line for line in lines if line["hidden"] == [name] and line["visible"]]
        named = Counter(line["named"] or f"({line['verdict']})" for line in own)
        told = Counter(line["verdict"] for line in own)
        print(f"{name:22} n {len(own):3}  right {sum(map(right, own)):3}  first named {dict(named)}  verdicts {dict(told)}")


def print_named(title: str, lines: Sequence[Line]) -> None:
    """Shares of right and wrong names."""
    print(f"{title}: right first {share(map(right, lines))}")
    print(f"    in the first three {share(line['wanted'][0] in [entry[0] for entry in line.get('ranking', [])] for line in lines)}")
    print(f"    wrong name first {share(line['named'] not in ('', line['wanted'][0]) for line in lines)}")


def print_ratios(title: str, lines: Sequence[Line], at: int, within: float) -> None:
    """Median, range and share within 1 ± ``within`` of the error ratio.   at : 0 before, 1 after adding."""
    values = sorted(line["ratio"][at] for line in lines if "ratio" in line)
    if values:
        near = share(abs(value - 1.0) <= within for value in values)
        print(f"{title} {values[len(values) // 2]:.3f} ({values[0]:.3f} to {values[-1]:.3f}); within 1.00 ± {within:.2f}: {near}")


def print_records(lines: Sequence[Line]) -> None:
    """Share of single records within 1.00 ± 0.05 after adding, fitted and held out; lines from before hold no records."""
    records = [record for line in lines for record in line.get("records", [])]
    for title, wanted in (("fitted", False), ("held out", True)):
        if values := [after for _, held_out, _, after in records if held_out is wanted]:
            print(f"    single records, {title}, within 1.00 ± 0.05: {share(abs(value - 1.0) <= 0.05 for value in values)}")


def print_held(title: str, lines: Sequence[Line]) -> None:
    """Held-out error against that of the true model class."""
    factor: Callable[[Line], float] = lambda line: line["held"][1] / line["best_held"]  # noqa: E731
    if lines:
        worst = sorted(((factor(line), line["hidden"][0]) for line in lines), reverse=True)[:5]
        print(f"{title}: {share(factor(line) <= 1.02 for line in lines)}; worst {[(round(f, 3), n) for f, n in worst]}")


def print_coverage(lines: Sequence[Line]) -> None:
    """How many intervals of 95 % hold the truth."""
    inside = [(name, entry[-1]) for line in lines for name, entry in line.get("covered", {}).items()]
    print(f"intervals that hold the truth, pooled: {share(held for _, held in inside if held is not None)}")
    for name in dict.fromkeys(name for name, _ in inside):
        print(f"    {name:50} {share(held for other, held in inside if other == name and held is not None)}")


def print_cost(lines: Sequence[Line]) -> None:
    """CPU time of a stage (base fit and search, then one more per effect), and memory."""
    seconds = sorted(line["cpu_s"] / (len(line.get("added", [])) + 1) for line in lines if "cpu_s" in line)
    if seconds:
        middle, most = seconds[len(seconds) // 2], max(line.get("peak_mb", 0.0) for line in lines)
        late = seconds[int(0.95 * (len(seconds) - 1))]
        print(f"CPU per stage: median {middle:.1f} s, 95 % below {late:.1f} s, longest {seconds[-1]:.1f} s; memory at most {most:.0f} MB")
