"""Intervals against repetition: a straight line in several records, with and without a law that is not quite right."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import stdtrit

from beltcomm.fit.estimate import Fitted
from beltcomm.fit.likelihood.arrowhead import ArrowheadJacobian
from beltcomm.fit.uncertainty.intervals import FRICTION, LAW, ParameterSpread, parameter_spread, rounded_share
from beltcomm.fit.uncertainty.intervals import SCALE as SCALE_SHARE

Array = NDArray[np.float64]
RECORDS, SAMPLES, SAMPLE_S, BLOCK = 12, 2000, 0.004, 50
TRUTH = np.array([2.0, -1.0])
SCALE = np.array([3.0, 0.5])


class Named(dict[str, float]):
    """Values by name, as a model has them."""

    effects: tuple[str, ...] = ()

    def driven_inertia(self) -> float:
        return 1.0


@dataclass
class Line:
    """A fit of two columns to records of noise, as the intervals see a problem."""

    columns: Array
    left: Array
    found: Array
    records: int
    effects: tuple[str, ...] = ()
    rounding: float = 0.0
    step_rad: float = 0.0

    def spread(self, at_bound: bool = False) -> ParameterSpread:
        """rounding : variance of what the first column is off by, which the fit has taken off the squares."""
        size = len(self.left) // self.records
        pieces = [
            SimpleNamespace(
                record=f"record {i}",
                value_samples=np.arange(size),
                motion=SimpleNamespace(sample_s=SAMPLE_S, samples=size),
                own_noise=False,
                step_rad=self.step_rad,
                noise_nm=1.0,
            )
            for i in range(self.records)
        ]
        x = self.found / SCALE
        blocks = np.arange(len(self.left)) // BLOCK
        count = np.bincount(blocks).astype(float)
        turned = np.zeros((2, 2))
        turned[0, 0] = self.rounding * SCALE[0] ** 2  # v(x) = σ² a²
        problem = SimpleNamespace(
            pieces=pieces, free=("line.slope", "body.level"), scale=SCALE, ends=size * np.arange(self.records + 1),
            low=np.array([-9.0, x[1] if at_bound else -9.0]), high=np.array([9.0, 9.0]),
            jacobian=lambda _x: ArrowheadJacobian(np.pad(self.columns * SCALE, ((0, 0), (0, 1))), np.zeros(1, dtype=np.intp)),
            weights=lambda _r: np.ones(len(self.left)), blocks=blocks, count=count, nuisance=None,
            piece_of_block=np.repeat(np.arange(self.records), len(count) // self.records), touches_noise=(False, False),
            model=SimpleNamespace(with_vector=lambda _v: None), full=lambda x: x,
            rounding_derivatives=lambda x: (count[:, None] * (2.0 * turned @ x), count[:, None, None] * turned),
        )  # fmt: skip
        model = Named({"line.slope": float(self.found[0]), "body.level": float(self.found[1])})
        model.effects, rms = self.effects, float(np.sqrt(np.mean(self.left**2)))
        return parameter_spread(cast("Fitted", SimpleNamespace(problem=problem, x=x, residual=self.left, model=model, ratio=rms)))


def line(rng: np.random.Generator, disagreement: float, records: int = RECORDS) -> Line:
    """Each record has a slope of its own, ``disagreement`` apart, noise of 1, and columns that look alike."""
    slope = rng.normal(size=(records, SAMPLES)) * rng.uniform(0.5, 1.5, (records, 1))
    columns = np.stack([slope.ravel(), 0.9 * slope.ravel() + 0.3 * rng.normal(size=slope.size)], axis=1)
    own = np.repeat(disagreement * rng.normal(size=records), SAMPLES)
    values = columns @ TRUTH + columns[:, 0] * own + rng.normal(size=len(columns))
    found = np.linalg.lstsq(columns, values, rcond=None)[0]
    return Line(columns, columns @ found - values, found, records)


def shares(disagreement: float, effects: tuple[str, ...], runs: int = 200) -> tuple[float, float]:
    """How often the interval of the slope holds the truth, and how often the one over time alone would."""
    rng = np.random.default_rng(8)
    held, alone = 0, 0
    for _ in range(runs):
        here = replace(line(rng, disagreement), effects=effects)
        spread = here.spread()
        width = spread.half_width({"line.slope": 1.0})
        assert width is not None
        error = abs(float(here.found[0] - TRUTH[0]))
        held += error <= width
        alone += error <= 1.96 * float(np.sqrt(spread.covariance[0, 0]))
    return held / runs, alone / runs


#: Three deviations of a share of 200 runs below 95 %.
COVERED = 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / 200)


def test_intervals_cover_where_the_law_is_right() -> None:
    held, _ = shares(0.0, ("coulomb",))
    assert held > COVERED


def test_records_that_disagree_widen_the_interval_of_a_law_that_is_a_likeness() -> None:
    held, alone = shares(0.2, ("line",))
    assert held > COVERED
    assert alone < 0.8


@pytest.mark.parametrize(("loudness", "wider"), [(1.0, False), (1.2, True)])
def test_records_widen_the_interval_of_an_exact_law_only_where_something_is_left(loudness: float, wider: bool) -> None:
    here = line(np.random.default_rng(5), 0.2)
    here = replace(here, left=here.left * loudness / np.sqrt(np.mean(here.left**2)))
    spread = here.spread()
    width = spread.half_width({"line.slope": 1.0})
    assert width is not None
    over_time = float(np.sqrt(spread.covariance[0, 0])) * float(stdtrit(spread.freedom, 0.975))
    assert (width > 1.5 * over_time) is wider
    assert wider or width == pytest.approx(over_time)


def rounded(rng: np.random.Generator, sigma: float) -> Line:
    """A line whose first column is known with an error only, found as its squares less those of the error say; in units of its noise."""
    true = rng.normal(size=(RECORDS * SAMPLES // 10, 2))
    seen = true + np.stack([sigma * rng.normal(size=len(true)), np.zeros(len(true))], axis=1)
    values = true @ TRUTH + rng.normal(size=len(true))
    taken_off = np.diag([len(true) * sigma**2, 0.0])
    found = np.linalg.solve(seen.T @ seen - taken_off, seen.T @ values)
    noise = np.sqrt(1.0 + (sigma * TRUTH[0]) ** 2)
    return Line(seen / noise, (seen @ found - values) / noise, found, RECORDS, rounding=(sigma / noise) ** 2)


def test_what_rounding_adds_to_a_column_is_no_information() -> None:
    """Half of the first column's squares is its own error: intervals hold the truth, and are no wider than the scatter asks for."""
    rng, errors, widths = np.random.default_rng(9), [], []
    for _ in range(200):
        here = rounded(rng, 1.0)
        width = here.spread().half_width({"line.slope": 1.0})
        assert width is not None
        errors.append(float(here.found[0] - TRUTH[0]))
        widths.append(width)
    assert np.mean(np.abs(errors) <= widths) > COVERED
    assert np.median(widths) < 1.3 * 1.96 * np.std(errors)


def test_what_rounding_pulls_in_every_record_is_no_disagreement_of_the_records() -> None:
    """Its part of the gradient is the same in all of them, and taken off."""
    rng, ratio = np.random.default_rng(10), []
    for _ in range(20):
        exact = rounded(rng, 1.0)
        widths = [here.spread().half_width({"line.slope": 1.0}) for here in (exact, replace(exact, effects=("line",)))]
        assert widths[0] is not None
        assert widths[1] is not None
        ratio.append(np.sqrt(widths[1] ** 2 - (LAW * exact.found[0]) ** 2) / widths[0])
    assert np.median(ratio) < 1.1


@pytest.mark.parametrize("records", [1, 2])
def test_fewer_groups_than_parameters_leave_no_interval_less_than_the_noise_does(records: int) -> None:
    """The scatter of one or two groups is none in some direction, and there the noise alone says how wide."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        whole = line(rng, 0.0, records)
        here = replace(whole, columns=whole.columns[: 100 * records], left=whole.left[: 100 * records])
        least = np.sqrt(np.diag(np.linalg.inv(here.columns.T @ here.columns)))
        for name, deviation in zip(("line.slope", "body.level"), least, strict=True):
            width = here.spread().half_width({name: 1.0})
            assert width is not None
            assert width > 1.96 * deviation


def test_a_sum_is_surer_than_its_parts() -> None:
    """Columns that look alike: what one takes the other gives."""
    spread = line(np.random.default_rng(1), 0.0).spread()
    parts = [spread.half_width({name: 1.0}) for name in ("line.slope", "body.level")]
    whole = spread.half_width({"line.slope": 1.0, "body.level": 0.9})
    assert whole is not None
    assert whole < 0.5 * min(p for p in parts if p is not None)


def test_no_law_is_better_than_half_a_percent() -> None:
    """Beside what the data leave open, in squares; the parameters of bodies are none of a law."""
    here = line(np.random.default_rng(4), 0.0, 1)
    plain, added = here.spread(), dataclasses.replace(here, effects=("line",)).spread()
    width = plain.half_width({"line.slope": 1.0})
    assert width is not None
    assert added.half_width({"line.slope": 1.0}) == pytest.approx(np.hypot(width, LAW * abs(here.found[0])))
    assert added.half_width({"body.level": 1.0}) == plain.half_width({"body.level": 1.0})


def test_what_sampling_leaves_of_scale_and_friction_is_in_every_interval() -> None:
    """In squares beside the rest; the scale is one for all, so that a ratio of two does not bear it."""
    names, values = ("cart.mass", "belt_stiffness.stiffness", "coulomb.level"), np.array([4.0, 2e5, 0.1])
    systematic = np.vstack((np.diag([0.0, 0.0, FRICTION * 0.1]), SCALE_SHARE * values))
    none = np.zeros((0, 3))
    spread = ParameterSpread(names, np.zeros((3, 3)), 100, none, np.zeros((0, 3, 3)), systematic)
    assert spread.half_width({"cart.mass": 1.0}) == pytest.approx(SCALE_SHARE * 4.0)
    assert spread.half_width({"coulomb.level": 1.0}) == pytest.approx(0.1 * np.hypot(SCALE_SHARE, FRICTION))
    assert spread.half_width({"cart.mass": 1.0 / 4.0, "belt_stiffness.stiffness": -1.0 / 2e5}) == pytest.approx(0.0, abs=1e-12)
    here = line(np.random.default_rng(4), 0.0, 1)
    both = [dataclasses.replace(here, effects=(name,)).spread().systematic for name in ("line", "coulomb")]
    assert [part[:-2].any() for part in both] == [True, False], "a law that is the machine's own leaves nothing open"


@pytest.mark.parametrize(("step_rad", "share"), [(0.0, 0.0), (SAMPLE_S**2, 1.0 / 3.0), (1.0, 1.0)])
def test_a_coarse_encoder_leaves_its_rounding_in_the_inertia(step_rad: float, share: float) -> None:
    """Of an inertia of 1 kg m², a noise of 1 N m and a step of T² rad rounding has half of the power of the noise."""
    pieces = [SimpleNamespace(step_rad=step_rad, motion=SimpleNamespace(sample_s=SAMPLE_S), noise_nm=1.0)]
    fitted = cast("Fitted", SimpleNamespace(model=Named(), problem=SimpleNamespace(pieces=pieces)))
    assert rounded_share(fitted) == pytest.approx(share, rel=1e-3)


@pytest.mark.parametrize(("loudness", "factor"), [(1.0, 1.0), (1.5, 1.5)])
def test_what_is_left_unexplained_widens_every_interval(loudness: float, factor: float) -> None:
    here = line(np.random.default_rng(4), 0.0, 1)
    here = dataclasses.replace(here, left=here.left * loudness / np.sqrt(np.mean(here.left**2)))
    spread = here.spread()
    assert spread.unexplained == pytest.approx(factor)
    assert spread.half_width({"line.slope": 1.0}) == pytest.approx(
        factor * (dataclasses.replace(spread, unexplained=1.0).half_width({"line.slope": 1.0}) or 0.0)
    )


@pytest.mark.parametrize("records", [1, 2])
def test_few_records_still_have_an_interval(records: int) -> None:
    here = line(np.random.default_rng(2), 0.0, records)
    width = here.spread().half_width({"line.slope": 1.0})
    assert width is not None
    assert 0.0 < width < 10.0 * np.sqrt(np.linalg.inv(here.columns.T @ here.columns)[0, 0])


def test_what_sits_at_a_bound_has_none() -> None:
    spread: Any = line(np.random.default_rng(3), 0.0).spread(at_bound=True)
    assert spread.half_width({"body.level": 1.0}) is None
    assert spread.half_width({"line.slope": 1.0, "body.level": 1.0}) is None
    assert spread.half_width({"line.slope": 1.0}) is not None


def test_the_units_of_a_parameter_do_not_change_its_interval() -> None:
    """A column 1e9 times larger than its neighbour leaves that one as well known as it is; a pseudo-inverse called it known exactly."""
    here = line(np.random.default_rng(4), 0.0)
    large = np.array([1.0, 1e9])
    other = replace(here, columns=here.columns * large, found=here.found / large)
    for name, factor in (("line.slope", 1.0), ("body.level", 1e-9)):
        width, wanted = other.spread().half_width({name: 1.0}), here.spread().half_width({name: 1.0})
        assert width == pytest.approx(factor * wanted, rel=1e-6)


def test_what_the_data_do_not_tell_has_a_huge_interval() -> None:
    here = line(np.random.default_rng(4), 0.0)
    same = replace(here, columns=here.columns[:, [0, 0]])
    width = same.spread().half_width({"line.slope": 1.0})
    told = here.spread().half_width({"line.slope": 1.0})
    assert width is not None
    assert told is not None
    assert width > 1e4 * told
