"""Results in plain sentences."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from click.testing import CliRunner

from beltcomm.app.laboratory import _in_own_units
from beltcomm.axis.terms import PLAIN
from beltcomm.cli.main import cli
from beltcomm.effects import EFFECTS, Effect, effect_named
from beltcomm.model import load_plant
from beltcomm.quantities import in_mm, mm, read_in
from beltcomm.sentences.ladder import number_lines
from beltcomm.sentences.words import SHOWN, verdict_lines
from beltcomm.verify import TrackingError, Verdict


def test_what_nobody_measured_has_no_unit() -> None:
    motor, cart = TrackingError(0.13e-3, 25e-6), TrackingError(0.55e-3, 13e-6)
    verdict = Verdict(True, motor, motor, None, cart, ())
    _, at_motor, at_carriage = verdict_lines(verdict, None)
    assert at_motor.split("at the motor")[1].strip() == "following error 0.13 mm (predicted 0.13 mm), settled 0.025 mm (predicted 0.025 mm)"
    assert (
        at_carriage.split("at the carriage")[1].strip() == "following error 0.55 mm, settled 0.013 mm (predicted; nothing measures there)"
    )
    (*_, seen) = verdict_lines(replace(verdict, measured_cart=cart), None)
    assert seen.split("at the carriage")[1].strip() == "following error 0.55 mm (predicted 0.55 mm), settled 0.013 mm (predicted 0.013 mm)"


@pytest.mark.parametrize("value", [0.0, 3.1e-8, 2.48e-6, 4.996e-7, 1.19e-6, 2.74e-5, 9.996e-5, 1.1e-4, 5e-4, 1.25e-3, 0.0213, 4.2])
def test_an_error_is_in_mm_with_three_digits_none_finer_than_a_tenth_of_a_micrometre(value: float) -> None:
    told = in_mm(value)
    assert re.fullmatch(r"\d+(\.\d*[1-9])?", told)
    half = 5e-5 if value >= 1e-6 else 5e-2 * 1e3 * value  # below a micrometre two digits
    assert abs(float(told) - 1e3 * value) <= max(5e-3 * 1e3 * value, half, 5e-6) * (1.0 + 1e-9)
    assert len(told.strip("0.").replace(".", "")) <= 3


def test_no_error_is_a_dash() -> None:
    assert mm(float("nan")) == "-"


@pytest.mark.parametrize(
    ("unit", "bound", "told"),
    [("N m", 50.0, (1e3, "mN m")), ("N m s/rad", 0.5, (1e3, "mN m s/rad")), ("N m", 1000.0, (1.0, "N m")), ("N s/m", 50.0, (1.0, "N s/m"))],
)
def test_friction_is_read_in_thousandths_a_rating_is_not(unit: str, bound: float, told: tuple[float, str]) -> None:
    assert read_in(unit, bound) == told


def test_verdict_lines_of_an_effect_and_the_page_have_one_unit_for_a_friction() -> None:
    model = load_plant("g_a").model
    known = replace(model.parameters["viscous.damping"], value=0.00253, interval=2e-5)
    (line,) = number_lines(effect_named("viscous"), replace(model, parameters={**model.parameters, "viscous.damping": known}))
    page = _in_own_units({"viscous.damping": {"value": 0.00253, "unit": "N m s/rad", "interval": 2e-5}}, PLAIN)["viscous.damping"]
    assert line.startswith("viscous.damping = 2.53 ± 0.02 mN m s/rad")
    assert (page["value"], page["unit"], page["interval"]) == (pytest.approx(2.53), "mN m s/rad", pytest.approx(0.02))
    assert SHOWN["viscous.damping"][1:] == ("mN m s/rad", 1e3)


@pytest.mark.parametrize(
    ("unit", "bound", "told"),
    [
        *[("m", 2e-3, (1e6, "µm")), ("m", 5e-3, (1e3, "mm")), ("m", 0.0, (1e3, "mm")), ("s", 0.2, (1e3, "ms")), ("s", 2000.0, (1.0, "s"))],
        *[("kg m2", 10.0, (1e4, "kg cm²")), ("N/m", 1e8, (1e-3, "kN/m")), ("N/m", 500.0, (1.0, "N/m")), ("N", 1e7, (1e-3, "kN"))],
        *[("N", 4000.0, (1.0, "N")), ("rad", 2e-3, (1e3, "mrad")), ("rad/s", 10.0, (1.0, "rad/s")), ("1", 0.5, (1.0, "1"))],
    ],
)
def test_what_belongs_to_the_mechanics_is_read_in_multiples_of_the_trade(unit: str, bound: float, told: tuple[float, str]) -> None:
    assert read_in(unit, bound) == told


def test_a_parameter_has_one_unit_in_the_table_of_the_model_and_at_its_effect() -> None:
    bounds = {f"{effect.owner or effect.name}.{p.name}": p for effect in EFFECTS for p in effect.parameters}
    differing = {
        name: (unit, read_in(bounds[name].unit, bounds[name].high))
        for name, (_, unit, factor) in SHOWN.items()
        if name in bounds and read_in(bounds[name].unit, bounds[name].high) != (factor, unit)
    }
    assert differing == {}


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_bounds_of_an_effect_have_their_unit_and_no_powers_of_ten(effect: Effect) -> None:
    text = CliRunner().invoke(cli, ["effects", effect.name]).stdout
    for parameter in effect.parameters:
        shown = rf"^  {parameter.name} \(\w+ side\), (-?[\d .]+ \.\.\. [\d .]+?)(| (?:[A-Za-zµ°]|1/)[^:]*): {re.escape(parameter.meaning)}$"
        (line,) = re.findall(shown, text, re.MULTILINE)
        factor, unit = read_in(parameter.unit, parameter.high)
        ends = [float(end.replace(" ", "")) for end in line[0].split("...")]
        assert ends == pytest.approx([factor * parameter.low, factor * parameter.high], rel=1e-3)
        assert line[1].strip() == ("" if unit == "1" else unit.replace("m2", "m²").replace("m3", "m³").replace("s2", "s²"))
