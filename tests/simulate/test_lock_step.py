"""Models in lock step against the masked kernel, one at a time: the same steps in another order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.effects import EFFECTS as CATALOGUE
from beltcomm.errors import UsageError
from beltcomm.fit.noise.propagation import noise_schedule
from beltcomm.fit.noise.whitening import whitener
from beltcomm.fit.residual.observer import Observation, Observer, innovations, tuned_observers, untuned_observer
from beltcomm.fit.residual.segment import Segment, _group_starts
from beltcomm.model import Model, build_model
from beltcomm.simulate.inverse import (
    FineMotion,
    _lock_step_groups,
    belt_load,
    belt_loads,
    fine_load,
    linear_innovations,
    motor_load,
    triangular_mean,
)
from beltcomm.simulate.kernels.observer import filter_columns
from beltcomm.simulate.kernels.switchboard import BEFORE_THE_LOAD, switchboard
from beltcomm.simulate.kernels.writer import acts_on_motor

Array = NDArray[np.float64]

EFFECTS = ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb", "cart_friction")
VALUES = {
    "motor.inertia": 7e-5, "cart.mass": 2.0, "transmission.ratio": 0.0124, "belt_stiffness.stiffness": 2e5, "belt_damping.damping": 20.0,
    "viscous.damping": 3e-4, "viscous_cart.damping": 10.0, "coulomb.level": 0.1, "cart_friction.level": 6.0, "backlash.gap": 4e-5,
    "tilt.angle": 0.1, "dead_time.time": 1.3e-3,
}  # fmt: skip


def model(*more: str, friction: float = 6.0) -> Model:
    values = VALUES | {"cart_friction.level": friction}
    effects = (*EFFECTS, *more)
    return build_model("axis", effects, {k: v for k, v in values.items() if k.split(".")[0] in (*effects, "motor", "cart", "transmission")})


def shaken(substeps: int, speed: float = 0.0) -> FineMotion:
    """Two tones, slow enough at times that the carriage sticks."""
    t = np.arange(1500 * substeps - substeps + 1) * 1e-3 / substeps
    theta = 0.05 * np.sin(2.0 * np.pi * 3.0 * t) + 0.01 * np.sin(2.0 * np.pi * 41.0 * t + 1.0) + speed * t
    omega = 0.3 * np.pi * np.cos(2.0 * np.pi * 3.0 * t) + 0.82 * np.pi * np.cos(2.0 * np.pi * 41.0 * t + 1.0) + speed
    return FineMotion(theta, omega, 1500, 1e-3, substeps, 0.0)


def beside(axis: Model, count: int) -> list[Array]:
    """The vector, and others with one parameter changed each; never the transmission."""
    names = [name for name in axis.parameters if name != "transmission.ratio"]
    return [axis.with_values({names[i % len(names)]: (1.0 + 0.01 * i) * axis[names[i % len(names)]]}).vector() for i in range(count)]


@pytest.mark.parametrize(("substeps", "speed", "friction", "count"), [(2, 0.0, 6.0, 1), (4, 0.0, 0.0, 9), (4, 8.0, 6.0, 21)])
def test_a_plain_belt_is_that_of_the_masked_kernel(substeps: int, speed: float, friction: float, count: int) -> None:
    axis, motion = model(friction=friction), shaken(substeps, speed)
    vectors, offsets = beside(axis, count), list(np.linspace(0.0, 2e-5, count))
    side_by_side = belt_loads(axis, motion, vectors, offsets)
    for vector, offset, found in zip(vectors, offsets, side_by_side.T, strict=True):
        whole = triangular_mean(fine_load(axis, motion, vector, offset)[0], substeps)
        np.testing.assert_allclose(found + motor_load(axis, motion, vector), whole, rtol=0.0, atol=1e-9 * np.abs(whole).max())


BEYOND = {
    "belt_slack.limit": 2e-5, "belt_slack.share": 0.6, "belt_slack.balance": 0.42, "belt_slack.rounding": 0.2,
    "stiffness_position.share": 0.7, "stiffness_position.offset": 0.2, "stiffness_position.pulley_distance": 0.9,
    "stiffness_position.middle": 0.1, "end_pulley.mass": 0.4, "end_pulley.share": 0.3, "end_pulley.split": 0.6,
    "viscous_end_pulley.damping": 8.0, "payload.mass": 0.6, "payload_mode.stiffness": 3e4, "payload_mode.damping": 12.0,
    "payload_mode.hardening": 2e6,
}  # fmt: skip


@pytest.mark.parametrize(
    "more",
    [
        ("belt_slack",),
        ("stiffness_position",),
        ("end_pulley", "viscous_end_pulley"),
        ("payload_mode",),
        ("belt_slack", "stiffness_position", "end_pulley"),
        ("belt_slack", "payload_mode"),
    ],
)
@pytest.mark.parametrize(("friction", "count"), [(6.0, 3), (0.0, 17)])
def test_what_stands_beside_a_plain_belt_is_that_of_the_masked_kernel(more: tuple[str, ...], friction: float, count: int) -> None:
    axis, motion = model(friction=friction), shaken(4)
    plain = belt_load(axis, motion, axis.vector(), 0.0)
    for name in more:
        axis = axis.with_effect(name)
    axis = axis.with_values({name: value for name, value in BEYOND.items() if name in axis.parameters})
    assert switchboard(axis.base_bodies, axis.effects).in_lanes
    vectors, offsets = beside(axis, count), list(np.linspace(0.0, 2e-5, count))
    side_by_side = belt_loads(axis, motion, vectors, offsets)
    assert np.abs(side_by_side[:, 0] - plain).max() > 0.01 * np.abs(plain).max(), "the effects must show, else nothing is compared"
    for vector, offset, found in zip(vectors, offsets, side_by_side.T, strict=True):
        whole = triangular_mean(fine_load(axis, motion, vector, offset)[0], 4)
        np.testing.assert_allclose(found + motor_load(axis, motion, vector), whole, rtol=0.0, atol=1e-9 * np.abs(whole).max())


def shorter(motion: FineMotion, samples: int) -> FineMotion:
    """Its first samples."""
    fine = (samples - 1) * motion.substeps + 1
    return replace(motion, theta=motion.theta[:fine].copy(), omega=motion.omega[:fine].copy(), samples=samples)


def observers(axis: Model, motions: list[FineMotion]) -> list[Observer]:
    """Before they have learned, one for each motion, all a little different."""
    found = []
    for number, motion in enumerate(motions):
        torque = np.concatenate((triangular_mean(fine_load(axis, motion)[0], motion.substeps)[1:], [0.0]))
        keep = np.ones(motion.samples, dtype=np.bool_)
        keep[[0, 700, 701, -1]] = False
        keep[300 : 345 + number] = False  # long enough to forget where the carriage is
        process_noise = 0.01 + 0.002 * number
        rounding = (1.0, 0.0) if number % 4 == 1 else (0.7, 0.1)
        found.append(untuned_observer(axis, motion, torque, keep, 1e-4, 5e-3, rounding, 1e-5, process_noise))
    return found


def seen(observer: Observer) -> Observation:
    """What it was worked out with."""
    return Observation(observer, observer.motion, observer.torque)


def each_alone(observers_of: list[Observer]) -> list[Observer]:
    """Learned one by one, so that none runs beside another."""
    return [tuned_observers([one])[0] for one in observers_of]


def same(found: Array, right: Array, name: str = "") -> None:
    np.testing.assert_allclose(found, right, rtol=0.0, atol=1e-6 * np.abs(right).max(), err_msg=name)


@pytest.mark.parametrize(("more", "count"), [((), 1), ((), 6), ((), 21), (("tilt",), 6), (("dead_time",), 6), (("payload_mode",), 9)])
def test_stretches_behind_a_gap_are_followed_as_by_the_masked_kernel(more: tuple[str, ...], count: int) -> None:
    """Each its own length, motion and noise: what a lane learns, and what it then says of another model."""
    axis = model("backlash", *more)
    motions = [shorter(shaken(16 if i % 3 else 4, speed=0.02 * i), 1500 - 29 * i) for i in range(count)]
    beside_each_other, alone = tuned_observers(observers(axis, motions)), each_alone(observers(axis, motions))
    assert any(one.watch.lost.any() for one in alone)  # else the correction by contact is not tried
    assert all(one.watch.forgets.any() for one in alone)
    for one, other in zip(beside_each_other, alone, strict=True):
        np.testing.assert_array_equal(one.watch.lost, other.watch.lost)
        for name in ("left", "white", "gains", "deviations", "shares"):
            same(getattr(one.watch, name), getattr(other.watch, name), name)
    for name in ("cart.mass", "backlash.gap"):
        vector = axis.with_values({name: 1.01 * axis[name]}).vector()
        quick = innovations([seen(one) for one in beside_each_other], axis, [vector] * count)
        slow = [innovations([seen(one)], axis, [vector])[0] for one in alone]
        for (white, left), (white_right, left_right) in zip(quick, slow, strict=True):
            same(white, white_right)
            same(left, left_right)


STRONG = {
    "belt_slack.limit": 2e-5, "belt_slack.share": 0.6, "stiffness_position.share": 0.7, "stiffness_position.middle": 0.1,
    "payload.mass": 0.6, "friction_position_cart.amount": 3.0, "stribeck_cart.amount": 2.0, "presliding_cart.length": 2e-4,
    "friction_position.place": 0.002, "viscous_end_pulley.damping": 20.0,
    "coulomb_end_pulley.level": 5.0, "viscous_load.damping": 0.01, "coulomb_load.level": 0.2,
    "elastic_shaft.stiffness": 5.0, "load.inertia": 5e-5, "friction_position.width": 0.005, "cable_chain.bend": 400.0,
    "pulley_eccentricity.sine": 0.02, "pulley_eccentricity_2.cosine": 0.01, "feed_constant.error": 0.01, "tilt.angle": 0.1,
    "quadratic_drag.factor": 20.0, "load_friction.share": 0.1, "cable_chain.rate": 30.0, "travel_ripple.sine": 3.0,
}  # fmt: skip
#: What an effect needs, and what it takes the place of.
BEFORE = {
    "viscous_end_pulley": ("end_pulley",), "coulomb_end_pulley": ("end_pulley",), "viscous_load": ("elastic_shaft",),
    "coulomb_load": ("elastic_shaft",), "stribeck_cart": ("stribeck",), "friction_position_cart": ("friction_position",),
}  # fmt: skip
INSTEAD = {"belt_spans": ("belt_stiffness",), "belt_sections": ("belt_stiffness", "belt_damping")}
BESIDE_A_GAP = [
    effect.name for effect in CATALOGUE
    if effect.name not in (*EFFECTS, "backlash") and not acts_on_motor(effect)
    and effect.slot not in (*BEFORE_THE_LOAD, "rigid", "load_of_record")
]  # fmt: skip


@pytest.mark.parametrize("name", BESIDE_A_GAP)
def test_every_effect_beyond_the_motor_runs_in_lock_step_as_by_the_masked_kernel(name: str) -> None:
    """Its law as it is written, and the same without branches, for eight models at a time."""
    without = model("backlash")
    for other in BEFORE.get(name, ()):
        without = without.with_effect(other)
    left_out = INSTEAD.get(name, ())
    axis = build_model("axis", (*(e for e in without.effects if e not in left_out), name), {})
    known = {key: item.value for key, item in without.parameters.items() if key in axis.parameters}
    axis = axis.with_values(known | {key: value for key, value in STRONG.items() if key in axis.parameters})
    motion = shorter(shaken(4, speed=0.5), 800)
    (bare,), (alone,) = each_alone(observers(without, [motion])), each_alone(observers(axis, [motion]))
    assert np.abs(alone.watch.wanted - bare.watch.wanted).max() > 1e-3 * np.abs(bare.watch.wanted).max(), "it must show"
    vectors = beside(axis, 8)
    quick = linear_innovations(axis, motion, vectors, alone.watch)
    for found, vector in zip(quick.T, vectors, strict=True):
        same(found, linear_innovations(axis, motion, [vector], alone.watch)[:, 0])


def test_no_gap_is_beside_a_load_that_moves_with_the_motor() -> None:
    """Which is why such a load is not among the effects above."""
    for effect in (one for one in CATALOGUE if one.slot == "rigid"):
        with pytest.raises(UsageError, match=f"{effect.name} brings cart.mass a second time"):
            model("backlash").with_effect(effect.name)
        with pytest.raises(UsageError, match="backlash needs a belt"):
            build_model("axis", (effect.name, "backlash"), {}, base_bodies=("motor",))


@pytest.mark.parametrize("more", [(), ("tilt",)])
def test_models_behind_one_observer_are_followed_as_by_the_masked_kernel(more: tuple[str, ...]) -> None:
    axis, motion = model("backlash", *more), shaken(16)
    (one,) = tuned_observers(observers(axis, [motion]))
    vectors = beside(axis, 11)
    for found, vector in zip(linear_innovations(axis, motion, vectors, one.watch).T, vectors, strict=True):
        same(found, linear_innovations(axis, motion, [vector], one.watch)[:, 0])


def test_neighbours_in_length_run_together_and_one_that_outlasts_them_alone() -> None:
    lengths = [900, 30, 800, 850, 790, 780, 2400, 770, 760, 750, 740]
    found = _lock_step_groups(range(len(lengths)), lengths)
    assert [[lengths[i] for i in some] for some in found] == [[2400], [900, 850, 800, 790, 780, 770, 760, 750], [740], [30]]


@pytest.mark.parametrize("shares", [(1.0, 0.0), (0.6, 0.3)])
@pytest.mark.parametrize("count", [1, 6, 35])
def test_columns_are_whitened_side_by_side_as_by_the_general_filter(shares: tuple[float, float], count: int) -> None:
    random = np.random.default_rng(count)
    keep, columns = random.random(800) < 0.9, random.standard_normal((800, count))
    known = whitener(keep, noise_schedule(model(), np.full(800, 0.2), 1e-3), 1e-4, 5e-3, shares)
    f, h = np.concatenate([known.F] * 2), np.concatenate([known.H] * 2)
    general = filter_columns(columns, keep, f, h, known.gains, known.deviations, np.zeros(800))
    np.testing.assert_allclose(known(columns, keep), general, rtol=0.0, atol=1e-11 * np.abs(general).max())
    # A path of another shape must not be taken for one of a single body.
    other = replace(known, F=np.where(known.F == 0.0, 0.01, known.F))
    f = np.concatenate([other.F] * 2)
    general = filter_columns(columns, keep, f, h, known.gains, known.deviations, np.zeros(800))
    np.testing.assert_array_equal(other(columns, keep), general)


def test_a_record_in_which_nothing_counts_leaves_nothing() -> None:
    motion = shaken(2)
    still = Segment("reversal", False, np.zeros(1500), np.zeros(1500), motion, np.zeros(1500, dtype=np.bool_), 5e-3, 1e-4, 0.0, group=4)
    assert still.group_sums(np.zeros(0)).shape == (0,)
    assert still.group_sums(np.zeros((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("size", [1, 2, 4])
def test_groups_never_cross_a_gap(size: int) -> None:
    keep = np.array([1, 1, 1, 0, 1, 0, 1, 1, 1, 1, 1, 0, 0, 1, 1], dtype=np.bool_)
    kept = np.flatnonzero(keep)
    firsts = _group_starts(keep, size)
    assert all(kept[first + size - 1] - kept[first] == size - 1 for first in firsts)
    assert len(firsts) == sum(run // size for run in (3, 1, 5, 2))
    assert len(_group_starts(np.zeros(5, dtype=np.bool_), size)) == 0
