"""Friction over speed in six orders (figure 3.10)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from beltcomm.report.style import FAINT, HELD_OUT, MEASURED, MODEL, RESIDUAL, SEVERE, Caption, figure, styled
from beltcomm.thesis.friction import FrictionComparison

COLOURS = (MODEL, RESIDUAL, MEASURED, FAINT, HELD_OUT, SEVERE)


def figures(study: FrictionComparison, caption: Caption) -> Mapping[str, Figure]:
    """All points of all orders, the fitted laws as lines; below, what the law leaves.  By name."""
    with styled():
        shown = figure("Friction in six orders (figure 3.10)", 5.6, caption)
        top, below = shown.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for order, colour in zip(study.orders, COLOURS, strict=True):
            speed = np.array([p.speed_rad_s for p in order.fit.points])
            torque = np.array([p.torque_nm for p in order.fit.points])
            top.plot(speed, 1e3 * torque, ".", color=colour, markersize=4, label=f"{order.name} {order.what}")
            for side in (-1.0, 1.0):
                grid = side * np.linspace(0.5, float(np.max(np.abs(speed))), 20)
                top.plot(grid, 1e3 * order.fit.torque_nm(grid), color=colour, linewidth=0.8)
            below.plot(speed, 1e3 * (torque - order.fit.torque_nm(speed)), ".", color=colour, markersize=4)
        top.set(ylabel="torque in mN m")
        top.legend(ncols=2)
        below.set(ylabel="left by the law in mN m", xlabel="motor speed in rad/s")
    return {"friction_orders": shown}
