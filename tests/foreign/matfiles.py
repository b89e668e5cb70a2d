"""MATLAB files of both kinds from one nested value: version 5 by SciPy, version 7.3 as MATLAB lays it out in HDF5."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat

HEADER = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon May  6 10:00:00 2024 HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM"


def write_v5(path: Path, value: dict[str, Any]) -> Path:
    savemat(path, {name: _v5(item) for name, item in value.items()}, oned_as="column")
    return path


def _v5(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _v5(item) for name, item in value.items()}
    if isinstance(value, list):
        cells = np.empty((1, len(value)), dtype=object)
        cells[0, :] = [_v5(item) for item in value]
        return cells
    return value


def write_v73(path: Path, value: dict[str, Any]) -> Path:
    """Structures as groups, arrays transposed, char as 16-bit codes, cells and structure arrays as references into #refs#."""
    with h5py.File(path, "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")
        for name, item in value.items():
            _put(file, name, item, refs)
    with open(path, "r+b") as raw:
        raw.write(HEADER)
    return path


def _put(group: Any, name: str, value: Any, refs: Any) -> Any:
    if isinstance(value, dict):
        made = group.create_group(name)
        made.attrs["MATLAB_class"] = np.bytes_("struct")
        for key, item in value.items():
            _put(made, key, item, refs)
    elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):  # a structure array
        made = group.create_group(name)
        made.attrs["MATLAB_class"] = np.bytes_("struct")
        for key in value[0]:
            made.create_dataset(key, data=_references([item[key] for item in value], refs))
    elif isinstance(value, list):
        made = group.create_dataset(name, data=_references(value, refs))
        made.attrs["MATLAB_class"] = np.bytes_("cell")
    elif isinstance(value, str):
        made = group.create_dataset(name, data=np.array([[ord(c)] for c in value], dtype=np.uint16))
        made.attrs["MATLAB_class"] = np.bytes_("char")
    else:
        values = np.atleast_2d(np.asarray(value, dtype=np.float64))
        values = values.T if np.ndim(value) == 1 else values  # MATLAB's column vector
        made = group.create_dataset(name, data=values.T)
        made.attrs["MATLAB_class"] = np.bytes_("double")
    return made


def _references(values: list[Any], refs: Any) -> Any:
    found = np.empty((len(values), 1), dtype=h5py.ref_dtype)
    for place, value in enumerate(values):
        found[place, 0] = _put(refs, f"r{len(refs)}", value, refs).ref
    return found
