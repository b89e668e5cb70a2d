"""95 % intervals of a fitted model: scatter of the gradient between groups of time (sandwich form)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from beltcomm.identify.problem import time_blocks
from beltcomm.laboratory.fitting import Fitted
from beltcomm.model import Model

#: s; groups between which the gradient is taken as independent.
GROUP_S = 2.0


def with_intervals(fitted: Fitted) -> Model:
    """The model with half widths of 95 %; None where a parameter sits at a bound."""
    problem = fitted.problem
    weights = problem.weights(fitted.residual)
    jacobian = problem.jacobian(fitted.x) * weights[:, None]
    at_bound = (fitted.x <= problem.low + 1e-9) | (fitted.x >= problem.high - 1e-9)
    free = np.flatnonzero(~at_bound & (np.linalg.norm(jacobian, axis=0) > 0.0))
    reduced = jacobian[:, free]
    labels = time_blocks(problem.pieces, GROUP_S)
    groups = int(labels.max()) + 1
    scores = np.zeros((groups, len(free)))
    np.add.at(scores, labels, reduced * (fitted.residual * weights)[:, None])
    information = np.linalg.pinv(reduced.T @ reduced)
    own = len(problem.free)
    freedom = max(groups - len(free), 3)
    covariance = information @ (scores.T @ scores) @ information * (groups / freedom)
    deviation = np.zeros(len(fitted.x))
    deviation[free] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    half = deviation[:own] * problem.scale[:own] * float(student.ppf(0.975, freedom))
    parameters = dict(fitted.model.parameters)
    for name, width, bound in zip(problem.free, half, at_bound[:own], strict=True):
        parameters[name] = replace(parameters[name], interval=None if bound else float(width))
    return replace(fitted.model, parameters=parameters)
