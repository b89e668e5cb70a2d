"""The model's smooth curve goes through what a simulated machine with that model shows, friction and all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from beltcomm import api
from beltcomm.identify.smooth_response import smooth_response
from beltcomm.model import load_plant
from beltcomm.rundata import analyse
from beltcomm.rundata.conditions import condition_of
from beltcomm.runfolder import RunFolder


def test_curve_and_band_lie_on_the_measured_response(tmp_path: Path) -> None:
    api.simulate("g_b", "egc-70-600", tmp_path / "run", options=api.Options(seed=3))
    model = load_plant("g_b").model
    sure = replace(model, parameters={n: replace(v, interval=0.05 * abs(v.value)) for n, v in model.parameters.items()})
    recording = RunFolder.open(tmp_path / "run").recordings("frf")[0]
    place = condition_of(recording, model["transmission.ratio"]).place_m
    assert place is not None
    measured = analyse.responses([recording])[recording.name]
    smooth = smooth_response(sure, recording, place, float(measured.freq_hz[0]), float(measured.freq_hz[-1]))
    assert smooth is not None
    band = (measured.freq_hz > 20.0) & (measured.freq_hz < 300.0)
    level = 20.0 * np.log10(np.abs(measured.h[band]))
    curve = np.interp(measured.freq_hz[band], smooth.freq_hz, 20.0 * np.log10(smooth.magnitude))
    assert abs(np.median(level - curve)) < 1.5
    assert np.median(np.abs(level - curve)) < 3.0
    assert np.all(smooth.low <= smooth.magnitude)
    assert np.all(smooth.magnitude <= smooth.high)
    assert 0.02 < float(np.median(smooth.high / smooth.low - 1.0)) < 1.0
    without = model.without_effect("coulomb") if "coulomb" in model.effects else model
    free = smooth_response(without, recording, place, 5.0, 10.0)
    assert free is not None
    assert free.magnitude[0] > smooth.magnitude[np.searchsorted(smooth.freq_hz, 5.0)], "friction takes of the motion"
