"""Legends stand where no curve runs."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.report import style


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("curve", [lambda x: x, lambda x: 1.1 - x, lambda x: 0.5 + 0.5 * np.cos(40.0 * x), lambda x: 0.0 * x + 0.3])
def test_no_curve_runs_through_a_legend(curve: object, scale: str) -> None:
    x = np.linspace(0.01, 1.0, 400)
    with style.styled():
        made = style.figure("a", 3.0, style.Caption("", ""))
        axes, _ = made.subplots(2, 1)
        axes.plot(x, 1.01 + 10.0 * curve(x), label="measured: sweep, 0.25 m")
        axes.plot(x, 1.0 + 9.0 * curve(x), label="model")
        axes.set_yscale(scale)
        style.legend(axes)
        style._laid_out(made).draw_without_rendering()
        box = axes.get_legend().get_window_extent()
        for line in axes.get_lines():
            assert not box.count_contains(axes.transData.transform(line.get_xydata()))
