"""The law of an effect over what a model without it leaves of the records, in its own coordinate."""

from __future__ import annotations

from matplotlib.figure import Figure

from beltcomm.laboratory.samples import Units
from beltcomm.report import style
from beltcomm.residuals.law import LawCurve


def law_figure(name: str, curve: LawCurve, units: Units, caption: style.Caption) -> Figure:
    """Dots: what is missing, by direction; lines: the law.

    Parameters
    ----------
    name : str
        Of the effect, in words.
    curve : LawCurve
        Law, and what is missing without it.
    units : Units
        Of the axis.
    caption : Caption
        Command and data.
    """
    unit = {"position": units.length, "speed": f"{units.length}/s", "time": "s", "angle": "rad", "torque": units.force}[curve.along]
    with style.styled():
        made = style.figure(f"{name}: its law over what the records show", 3.6, caption)
        axes = made.subplots()
        both = (
            ("positive direction", curve.missing_forward, curve.forward, style.RESIDUAL),
            ("negative direction", curve.missing_backward, curve.backward, style.SEVERE),
        )
        for words, missing, law, colour in both:
            axes.plot(curve.x, units.factor * missing, ".", color=colour, markersize=6, label=f"measured without it, {words}")
            axes.plot(curve.x, units.factor * law, color=colour, linewidth=1.6, label=f"law, {words}")
        axes.axhline(0.0, color=style.FAINT, linewidth=1.0, zorder=0.5)
        axes.set_xlabel(f"{'motor ' if curve.along in ('angle', 'torque') else ''}{curve.along} in {unit}")
        axes.set_ylabel(f"{units.word} in {units.small}")
        axes.legend(loc="best", fontsize=8)
    return made
