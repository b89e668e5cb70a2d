"""Orders of the sweep on few speeds: what is built into the axis comes out, and the order tells where it does not."""

from __future__ import annotations

import pytest

from beltcomm.report.style import Caption
from beltcomm.thesis import friction
from beltcomm.thesis.figures.friction import figures

FEW = (1.5, 0.005, 0.2, 0.02, 0.8, 1.1, 0.002, 0.4, 0.05)


@pytest.fixture(scope="module")
def study() -> friction.FrictionComparison:
    """Nine speeds, three repeats, and a time constant as much shorter: the whole table takes half a minute."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(friction, "SHUFFLED", FEW)
        patch.setattr(friction, "REPEATS", 3)
        patch.setattr(friction, "WARM_S", 30.0)
        return friction.compare()


def test_the_list_is_that_of_the_source() -> None:
    """(A.1): 38 speeds, 1 to 9 mm/s by 1, 10 to 90 by 10, 0.1 to 2 m/s by 0.1 m/s, each once."""
    wanted = [k / 1000 for k in range(1, 10)] + [k / 100 for k in range(1, 10)] + [k / 10 for k in range(1, 21)]
    assert sorted(friction.SHUFFLED) == pytest.approx(wanted)


def test_the_order_alone_moves_the_viscous_friction(study: friction.FrictionComparison) -> None:
    """Each order finds the friction of the time at which it drove fast; to 6 %, because what counts as fast is the upper half here."""
    by = {order.name: order for order in study.orders}
    assert by["II"].fit.viscous.value > 1.05 * by["I"].fit.viscous.value
    for order in study.orders[:4]:
        assert order.fit.viscous.value == pytest.approx(order.viscous_then, rel=0.06)
    assert by["I"].fit.viscous.value < by["III"].fit.viscous.value < by["II"].fit.viscous.value


def test_wear_and_load_come_out(study: friction.FrictionComparison) -> None:
    """Built in: -10 % Coulomb by wear; table A.10: +8.7 % with 11.2 kg."""
    by = {order.name: order.fit.coulomb.value for order in study.orders}
    assert by["V"] / by["I"] == pytest.approx(0.9, abs=0.02)
    assert by["VI"] / by["V"] == pytest.approx(0.125 / 0.115, abs=0.04)


def test_the_stribeck_effect_shows_below_the_fitted_speeds(study: friction.FrictionComparison) -> None:
    """12 mN m at standstill, exp(-(ω/2.5)²) of it at a speed: 9 to 12 mN m at 2 and 5 mm/s, less what the fitted law takes of it."""
    for order in study.orders[:4]:
        assert 5e-3 < order.slow_nm < 13e-3


def test_words_and_figure(study: friction.FrictionComparison) -> None:
    text = friction.lines(study)
    assert [line.split()[0] for line in text[2:8]] == ["I", "II", "III", "IV", "V", "VI"]
    assert list(figures(study, Caption("test", "none"))) == ["friction_orders"]
