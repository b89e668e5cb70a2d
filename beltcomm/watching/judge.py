"""One move of production judged by the fit of a run: error over the noise, and what of the axis it tells anew, with intervals.

The likelihood, the noise and the torque path are those of the run's own fit; all parameters stay as fitted but the few that age, which
the move alone tells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.effects import EFFECTS
from beltcomm.errors import DataError
from beltcomm.fit.estimate import Fitted, evaluate_at, fit, problem_of
from beltcomm.fit.records import Data, prepare_records
from beltcomm.fit.uncertainty.intervals import parameter_spread
from beltcomm.laboratory.score import Scorer, ground_of
from beltcomm.laboratory.selection import bic_penalty, may_add
from beltcomm.model import Model
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording
from beltcomm.rundata.fitted_run import Opened
from beltcomm.simulate.stopping import total_friction, total_viscous
from beltcomm.watching.estimates import MoveEstimate
from beltcomm.watching.places import MOST, WIDTH_M, friction_at_places

#: Parameters that age or are loaded, by the quantity that is shown: the first of each that the model has is told by a move.
FOLLOWED: dict[str, tuple[str, ...]] = {
    "coulomb_total": ("coulomb.level", "cart_friction.level", "coulomb_load.level"),
    "viscous_total": ("viscous.damping", "viscous_cart.damping", "viscous_load.damping"),
    "belt_stiffness.stiffness": ("belt_stiffness.stiffness",),
    "belt_spans.specific_stiffness": ("belt_spans.specific_stiffness",),
    "belt_sections.specific_stiffness": ("belt_sections.specific_stiffness",),
    "cart.mass": ("cart.mass",),
}
#: Of an axis without a carriage behind a belt.
RIGID: dict[str, tuple[str, ...]] = {"motor.inertia": ("motor.inertia",), "mass": ("mass",)}
ITERATIONS = 6
#: Share of its value that the interval of one move may have, from which on it tells nothing of a quantity.
VAGUE = 1.0
#: Suspects that are named.
SUSPECTS = 3
#: Values of the residual without which the quantities are not told: as many moves are taken together as make them, some at most, for behind
#: a coarse encoder few of a move are independent.   Values without which a motion is no move.
ENOUGH, MOST_TOGETHER, FEWEST_VALUES = 120, 20, 8
#: m (rad without a transmission), to which starts and ends of moves are alike that count as one move driven again: with the same payload.
ALIKE = 0.01
#: Times the run's value, and share of it, beyond which a stiffness or a load is no axis that still moves but another minimum of the fit.
IMPLAUSIBLE = 2.5
#: Error, as a share of the run's, above which other stiffnesses are tried; those, as shares of the run's; how much better one must be:
#: a belt that rings several times in a move leaves a minimum for every ring more or less, of which a fit that finds another load takes the
#: wrong one.
ASTRAY, STIFFNESSES, BETTER = 1.2, (0.9, 0.8, 0.7, 0.6, 1.1), 0.8


@dataclass(frozen=True)
class JudgedMove:
    """One move.

    Attributes
    ----------
    ratio : float
        Error over the noise with the few parameters that age told anew: 1 when the model still explains the axis.
    quantities : dict of str to MoveEstimate
        By the key of a trend, told by this move and those before it that told none; without those that they do not tell.
    places : dict of int to MoveEstimate
        Friction beside the model's at each place of the travel, by its number, N m.
    travel_m, duration_s, following_m
        Way (rad where no carriage is known), time, following error of the motor where the stream has a reference, else None.
    """

    ratio: float
    ratio_interval: float
    quantities: dict[str, MoveEstimate]
    places: dict[int, MoveEstimate]
    travel_m: float
    duration_s: float
    following_m: float | None


class Judge:
    """The fit of a run, that moves are held against.

    Attributes
    ----------
    reference : dict of str to MoveEstimate
        What the run says of each quantity that is followed.
    ratio : float
        Error over the noise that the run's model leaves of its own records, at least 1.
    width_m : float or None
        Length of a place of the travel, at which friction is followed; None for an axis without a transmission.
    """

    def __init__(self, opened: Opened) -> None:
        self._data, self._fitted, self.axis = opened.data, opened.fitted, opened.folder.axis
        self.model: Model = opened.fitted.model
        free = set(opened.fitted.problem.free)
        wanted = FOLLOWED if "cart" in self.model.base_bodies else {**FOLLOWED, **RIGID}
        self._names = {key: name for key, names in wanted.items() if (name := next((n for n in names if n in free), None)) is not None}
        # What the run has found to be nothing has no shares of itself.
        self._names = {key: name for key, name in self._names.items() if self._value(key, self.model) > 0.0}
        spread = parameter_spread(opened.fitted)
        self.reference = {}
        for key in self._names:
            half = spread.half_width(self._weights(key))
            self.reference[key] = MoveEstimate(self._value(key, self.model), half or 0.0)
        self.ratio = max(1.0, opened.fitted.held_out_ratio or 0.0, opened.fitted.ratio)
        self._together: dict[tuple[int, ...], tuple[list[Recording], int]] = {}
        self._driven: set[tuple[int, ...]] = set()
        self._latest: dict[tuple[int, ...], Model] = {(): self.model}
        travel = self.axis.travel.ends_m
        self.width_m = max(WIDTH_M, (travel[1] - travel[0]) / MOST) if self.model.get("transmission.ratio") else None
        self.zero_m = _zero_of(opened.records.recordings, self.model.get("transmission.ratio"))

    def _weights(self, key: str) -> dict[str, float]:
        """Factors of the fitted parameters whose sum a quantity is."""
        ratio = self.model.get("transmission.ratio") or 1.0
        parts = {
            "coulomb_total": {"coulomb.level": 1.0, "cart_friction.level": ratio},
            "viscous_total": {"viscous.damping": 1.0, "viscous_cart.damping": ratio**2},
        }.get(key)
        free = self._fitted.problem.free
        return {name: weight for name, weight in parts.items() if name in free} if parts else {self._names[key]: 1.0}

    def _value(self, key: str, model: Model) -> float:
        if not model.get("transmission.ratio"):
            return model[self._names[key]]
        if key == "coulomb_total" and self._names[key] in ("coulomb.level", "cart_friction.level"):
            return total_friction(model)
        if key == "viscous_total" and self._names[key] in ("viscous.damping", "viscous_cart.damping"):
            return total_viscous(model)
        return model[self._names[key]]

    def prepared(self, moves: Sequence[Recording], model: Model | None = None) -> Data:
        """Moves as the run's fit sees its own records, behind a belt each model in the noise that it passes on itself.

        In the noise of another belt rounding is least at that belt's stiffness, so that a gentle move told where its fit began.

        Parameters
        ----------
        moves : sequence of Recording
        model : Model or None
            None for the run's.
        """
        data = self._data
        shares = [piece.rounding for piece in data.held_out or data.fitted]
        usual = (float(np.median([s[0] for s in shares])), float(np.median([s[1] for s in shares])))
        known = (data.noise_nm, data.step_rad, {move.name: usual for move in moves}, data.substeps, data.path, data.reversals, data.colour)
        seen = prepare_records(moves, model or self.model, *known, data.single)
        own = "cart" in self.model.base_bodies
        return replace(seen, fitted=tuple(replace(piece, own_noise=own or piece.own_noise) for piece in seen.fitted))

    def _fitted_to(self, moves: Sequence[Recording], kind: tuple[int, ...] = ()) -> Fitted:
        """The run's model with what ages fitted to moves: from where the last ones left it; where that is astray, from elsewhere, too."""

        def best_of(*fits: Fitted) -> Fitted:
            return min(fits, key=lambda one: (not self._plausible(one), one.ratio))

        start = self._latest.get(kind, self._latest[()])
        best = self._fit(moves, start)
        if start is not self.model and (not self._plausible(best) or best.ratio > ASTRAY * self.ratio):
            best = best_of(best, self._fit(moves, self.model))
        stiffness = next((name for name in self._names.values() if name.startswith("belt_")), None)
        if stiffness is None or not best.ratio > ASTRAY * self.ratio:
            return best
        bounds = self.model.parameters[stiffness]
        others = [float(np.clip(share * bounds.value, bounds.low, bounds.high)) for share in STIFFNESSES]
        tried = [self._fit(moves, self.model.with_values({stiffness: value})) for value in others]
        other = best_of(*tried)
        return other if self._plausible(other) and other.ratio < BETTER * best.ratio else best

    def _plausible(self, fitted: Fitted) -> bool:
        """True if stiffness and load are those of an axis that moves."""
        names = [name for name in self._names.values() if not name.endswith((".level", ".damping"))]
        return all(1.0 / IMPLAUSIBLE < fitted.model[name] / self.model[name] < IMPLAUSIBLE for name in names)

    def _fit(self, moves: Sequence[Recording], start: Model) -> Fitted:
        return fit(self.prepared(moves, start), start, ITERATIONS, fixed=self._kept)

    @property
    def _kept(self) -> list[str]:
        return [name for name in self.model.parameters if name not in self._names.values()]

    def judge(self, move: Recording) -> JudgedMove:
        """One more move held against the fit of the run; raises DataError for one that holds nothing that counts."""
        data = self.prepared([move])
        values = sum(len(piece.value_samples) for piece in data.fitted)
        if values < FEWEST_VALUES:
            raise DataError(f"{move.name} moves too little to tell anything of the axis")
        kind = self._kind(move)
        together, before = self._together.get(kind, ([], 0))
        self._together[kind] = together, before + values
        together.append(move)
        if before + values >= ENOUGH or len(together) >= MOST_TOGETHER:
            fitted = self._fitted_to(together, kind)
            found, places = {}, {}
            if self._plausible(fitted):
                found, places = self._told(fitted), self._places(fitted, together)
                self._latest[kind] = self._latest[()] = fitted.model
            del self._together[kind]
        else:
            problem = problem_of(data, self._latest.get(kind, self._latest[()]), self._kept)  # what has aged is no error of the model
            fitted, found, places = evaluate_at(data, problem, problem.start()), {}, {}
        ratio = self._scale(move)
        off = None
        if move.reference_position is not None:
            off = ratio * float(np.max(np.abs(move.reference_position - move.position)))
        chance = NORMAL_95 * fitted.ratio / math.sqrt(2.0 * fitted.problem.samples)
        return JudgedMove(fitted.ratio, chance, found, places, ratio * float(np.ptp(move.position)), float(move.t_s[-1] - move.t_s[0]), off)

    def _told(self, fitted: Fitted) -> dict[str, MoveEstimate]:
        spread, ratio = parameter_spread(fitted), self.model.get("transmission.ratio") or 1.0
        found = {}
        for key, name in self._names.items():
            half = spread.half_width({name: 1.0})
            factor = {"cart_friction.level": ratio, "viscous_cart.damping": ratio**2}.get(name, 1.0)
            if half is not None and math.isfinite(half) and factor * half < VAGUE * abs(self.reference[key].value):
                found[key] = MoveEstimate(self._value(key, fitted.model), factor * half)
        return found

    def _scale(self, move: Recording) -> float:
        """m of travel per unit of a move's position; 1 where no carriage is known."""
        return (self.model.get("transmission.ratio") or 1.0) if move.side != "load" else 1.0

    def _kind(self, move: Recording) -> tuple[int, ...]:
        """Start and end of a move that was driven before, by which it is taken together with none but the like; of others, ()."""
        scale, start = self._scale(move), move.sidecar.start_position_m
        zero = 0.0 if start is None else start - scale * float(move.position[0])
        kind = tuple(round((zero + scale * float(move.position[at])) / ALIKE) for at in (0, -1))
        if kind in self._driven:
            return kind
        self._driven.add(kind)
        return ()

    def _places(self, fitted: Fitted, together: Sequence[Recording]) -> dict[int, MoveEstimate]:
        """Friction at each place, where the moves say where they were driven."""
        known = self.width_m is not None and all(move.sidecar.start_position_m is not None for move in together)
        return friction_at_places(fitted, self.width_m) if known and self.width_m is not None else {}

    def suspects(self, moves: Sequence[Recording]) -> list[tuple[str, str, float]]:
        """Effects by which the error of these moves would fall most, by the score test: name, title, evidence."""
        fitted = self._fitted_to(moves)
        scorer, ground = Scorer(fitted), ground_of(fitted, fitted.problem.pieces, self.axis)
        found = []
        for effect in EFFECTS:
            if effect.trials is None or effect.bound or effect.needs_observer or not may_add(fitted, effect):
                continue
            ways = scorer.score(effect, ground)
            if ways and (evidence := ways[0].drop - bic_penalty(effect, fitted, len(ways))) > 0.0:
                found.append((effect.name, effect.title, float(evidence)))
        return sorted(found, key=lambda one: -one[2])[:SUSPECTS]

    def start_of(self, position: float) -> float | None:
        """Carriage position, m, at a position of the drive, as in the run; None where the run does not tell or that is off the travel."""
        ratio = self.model.get("transmission.ratio")
        if self.zero_m is None or not ratio:
            return None
        there, travel = self.zero_m + ratio * position, self.axis.travel
        low, high = travel.min_m, travel.max_m
        if low is not None and high is not None and not low - 0.1 * (high - low) <= there <= high + 0.1 * (high - low):
            return None
        return there


def _zero_of(recordings: Sequence[Recording], ratio: float | None) -> float | None:
    """Carriage position at the drive's zero, m, in all records of a run alike; None where they differ."""
    zeros = [
        r.sidecar.start_position_m - ratio * float(r.position[0]) for r in recordings if r.sidecar.start_position_m is not None and ratio
    ]
    return float(np.median(zeros)) if zeros and np.ptp(zeros) < 1e-3 else None
