"""Gains of a cascade as those of a PID controller and back, for people and programs (appendix B)."""

from __future__ import annotations

from pathlib import Path

from beltcomm.control import Cascade
from beltcomm.design.conversion import Cascades, Pid, to_cascades, to_pid
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.given import Place, pasted, place
from beltcomm.result import Result, plain
from beltcomm.rundata.store import cascade_from_dict, saved_design
from beltcomm.runfolder import RunFolder


def convert(run: Place | None = None, *, cascade: Cascade | None = None, pid: Pid | None = None, period_s: float = 0.0) -> Result:
    """The other form of one of the three: the design of a run (at its drive's loop period), a cascade, a PID.

    Parameters
    ----------
    run : Place or None
        Run folder with a design.
    cascade : Cascade or None
        The cascade to be written as a PID.
    pid : Pid or None
        The PID to be written as a cascade.
    period_s : float
        T of the loops, s; 0 for the continuous form, which is appendix B's when T_R is 0 too.

    Returns
    -------
    Result
        The gains of the other form.

    Raises
    ------
    UsageError
        For none or more than one of them.
    Refused
        For a PID that no cascade equals.
    DataError
        For a damaged run.
    """
    if sum(given is not None for given in (run, cascade, pid)) != 1:
        raise UsageError("give what is to be converted: a run folder, or K_P, K_I and K_PP of a cascade, or P, I and D of a PID")
    run = None if run is None else place(run)
    if run is not None:
        cascade, period_s = _designed(run)
    if cascade is not None:
        return _from_cascade(cascade, period_s, run)
    assert pid is not None
    found = to_cascades(pid, period_s)
    fast = found.fast
    data = {"pid": _pid_data(pid), "period_s": period_s, "slow": _gains(found.slow), "discriminant": found.discriminant}
    data["fast"] = None if fast is None else _gains(fast)
    return Result(data, [*_pid_lines(pid), *_cascades_lines(found), f"Computed {_form(pid.derivative_filter_s, period_s)}."])


def _designed(run: Path) -> tuple[Cascade, float]:
    """The cascade of a run's design and the period of the loops that it was designed for, s."""
    saved = saved_design(RunFolder.open(run))
    try:
        return cascade_from_dict(saved), float(saved["structure"]["period_s"])
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"the design in {run} is damaged ({error}); run `beltcomm design {pasted(run)}` again") from error


def _from_cascade(cascade: Cascade, period_s: float, run: Path | None) -> Result:
    pid = to_pid(cascade, period_s)
    try:
        other = next((c for c in _both(to_cascades(pid, period_s)) if abs(c.ki_nm_rad - cascade.ki_nm_rad) > 1e-6 * c.ki_nm_rad), None)
    except Refused:  # a double root that rounding has split
        other = None
    text = [_cascade_line("cascade", cascade), *_pid_lines(pid)]
    if other is not None:
        text.append(_cascade_line("the same PID is also the cascade", other))
    filters = [f"{cascade.prefilter.kind} prefilter"] if cascade.prefilter.kind != "none" else []
    filters += ["additional low-pass"] if cascade.prefilter.roll_off_rad_s else []
    if filters:
        text.append(f"In front of all three terms, but not of the feedforward torque, stays: {' and '.join(filters)}.")
    text.append(f"Computed {_form(cascade.velocity_filter_s, period_s)}.")
    data = {"run": None if run is None else str(run), "cascade": _gains(cascade), "period_s": period_s, "pid": _pid_data(pid)}
    return Result({**data, "other": None if other is None else _gains(other)}, text)


def _both(found: Cascades) -> list[Cascade]:
    return [found.slow] if found.fast is None else [found.slow, found.fast]


def _gains(cascade: Cascade) -> dict[str, object]:
    data = dict(plain(cascade))
    data["velocity_feedforward"] = data.pop("feedforward")["velocity"]
    return data


def _pid_data(pid: Pid) -> dict[str, object]:
    """A PID as a mapping, with B, B − D, and the times of the standard form, s: T_i = P/I, T_d = D/P."""
    data = dict(plain(pid))
    data["velocity_nm_s_rad"] = pid.reference_gain_nm_s_rad
    data["velocity_feedforward_nm_s_rad"] = pid.velocity_feedforward_nm_s_rad
    data["integral_time_s"] = pid.kp_nm_rad / pid.ki_nm_rad_s if pid.ki_nm_rad_s else None
    data["derivative_time_s"] = pid.kd_nm_s_rad / pid.kp_nm_rad
    return data


def _pid_lines(pid: Pid) -> list[str]:
    """A PID in words."""
    integral = f"T_i {1e3 * pid.kp_nm_rad / pid.ki_nm_rad_s:.4g} ms, " if pid.ki_nm_rad_s else ""
    lines = [
        f"PID: P {pid.kp_nm_rad:.6g} N m/rad, I {pid.ki_nm_rad_s:.6g} N m/(rad s), D {pid.kd_nm_s_rad:.6g} N m s/rad "
        f"({integral}T_d {1e3 * pid.kd_nm_s_rad / pid.kp_nm_rad:.4g} ms)",
        f"  reference: setpoint weight b {pid.setpoint_weight:.6g}, {pid.reference_gain_nm_s_rad:.6g} N m s/rad on its velocity "
        f"({pid.velocity_feedforward_nm_s_rad:+.3g} beside D)",
    ]
    if pid.kd_nm_s_rad < 0.0:
        lines.append("  D is negative, because the integral time K_P/K_I is shorter than T_R + T; most drives take no such gain")
    return lines


def _cascades_lines(found: Cascades) -> list[str]:
    """Both cascades of a PID in words, and which to take."""
    if found.fast is None:
        return [_cascade_line("cascade, the only one", found.slow)]
    return [
        _cascade_line("cascade, take this one", found.slow),
        _cascade_line("the other root, same closed loop", found.fast),
        "  The first has the slower position loop around the stiffer velocity loop, and overshoots less without velocity feedforward; take "
        "the other where its gains are the known ones, or where the velocity loop alone needs the larger phase margin.",
    ]


def _cascade_line(name: str, cascade: Cascade) -> str:
    """A cascade in words."""
    integral = f", T_N {1e3 * cascade.kp_nm_s_rad / cascade.ki_nm_rad:.4g} ms" if cascade.ki_nm_rad else ""
    return (
        f"{name}: K_P {cascade.kp_nm_s_rad:.6g} N m s/rad, K_I {cascade.ki_nm_rad:.6g} N m/rad, K_PP {cascade.kpp_1_s:.6g} 1/s, "
        f"K_v {cascade.feedforward.velocity:.6g}{integral}"
    )


def _form(velocity_filter_s: float, period_s: float) -> str:
    if velocity_filter_s + period_s == 0.0:
        return "with an ideal derivative, as appendix B (B.3)"
    loops = f"in loops of {1e3 * period_s:g} ms" if period_s else "in the continuous form"
    lag_s = velocity_filter_s + period_s
    return f"with the velocity filter of {1e3 * velocity_filter_s:g} ms, {loops}: D is K_P less K_I times {1e3 * lag_s:g} ms"
