"""``beltcomm convert``: gains of a P-PI cascade as a PID controller, and back."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import completion
from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api
from beltcomm.cli.help import About, option
from beltcomm.errors import UsageError


@click.command("convert")
@click.argument("run", type=click.Path(path_type=Path), required=False, shell_complete=completion.runs)
@click.option("--kp", type=float, metavar="K_P", help="Of the cascade's velocity loop, N m s/rad.")
@click.option("--ki", type=float, metavar="K_I", help="Of the cascade's velocity loop, N m/rad.")
@click.option("--kpp", type=float, metavar="K_PP", help="Of the cascade's position loop, 1/s.")
@click.option("--pid", type=float, nargs=3, metavar="P I D", help="N m/rad, N m/(rad s), N m s/rad.")
@option("--weight", topic=About.CONTROLLER, type=float, help="Setpoint weight b of the PID's P; 1 when left out, the error itself.")
@option("--velocity-gain", topic=About.CONTROLLER, type=float, help="The PID's gain on the reference velocity, N m s/rad; D when left out.")
@option("--velocity-feedforward", topic=About.CONTROLLER, type=float, help="K_v of the cascade; 1 when left out.")
@click.option(
    "--velocity-filter", "velocity_filter_s", type=shared.QuantityType("velocity_filter_s"), help="T_R of (6.1); 0 when left out."
)
@click.option("--period", "period_s", type=shared.QuantityType("period_s"), help="Of the loops; 0, the continuous form, when left out.")
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation,
    /,
    run: Path | None,
    kp: float | None,
    ki: float | None,
    kpp: float | None,
    pid: tuple[float, float, float] | None,
    weight: float | None,
    velocity_gain: float | None,
    velocity_feedforward: float | None,
    velocity_filter_s: float | None,
    period_s: float | None,
) -> int:
    """Convert the gains of a P-PI cascade into the PID controller with the same closed loop, or a PID into its cascades.

    Give --kp, --ki and --kpp, or --pid P I D, or the run folder RUN for its design.

    Example: beltcomm convert runs/axis-1
    """
    from beltcomm.control import Cascade, Feedforward
    from beltcomm.design.conversion import Pid

    gains = {"--kp": kp, "--ki": ki, "--kpp": kpp}
    known = {name: value for name, value in gains.items() if value is not None}
    _only("--kp, --ki and --kpp", {"--velocity-feedforward": velocity_feedforward}, bool(known))
    _only("--pid", {"--weight": weight, "--velocity-gain": velocity_gain}, pid is not None)
    _only("gains, not for a run, which knows its own", {"--velocity-filter": velocity_filter_s, "--period": period_s}, run is None)
    if known and len(known) < len(gains):
        raise UsageError(f"a cascade needs --kp, --ki and --kpp; {', '.join(name for name in gains if name not in known)} is missing")
    cascade = controller = None
    if kp is not None and ki is not None and kpp is not None:
        forward = Feedforward(velocity=1.0 if velocity_feedforward is None else velocity_feedforward)
        cascade = Cascade(kp, ki, kpp, velocity_filter_s or 0.0, feedforward=forward)
    if pid is not None:
        controller = Pid(*pid, 1.0 if weight is None else weight, velocity_gain, velocity_filter_s or 0.0)
    return frame.show(api("beltcomm.jobs.convert").convert(run, cascade=cascade, pid=controller, period_s=period_s or 0.0))


def _only(owner: str, options: dict[str, float | None], allowed: bool) -> None:
    """Raise UsageError for an option that was given without what it belongs to."""
    given = [name for name, value in options.items() if value is not None]
    if given and not allowed:
        raise UsageError(f"{given[0]} is for {owner}; leave it out")
