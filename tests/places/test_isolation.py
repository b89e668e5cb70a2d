"""What lies in the working directory is neither code nor configuration."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from beltcomm import isolation
from marks import quick

#: Modules that Python, numba, joblib or this package import by name, each as a stranger's file that says that it was run.
STRANGERS = ("numpy", "json", "runpy", "pickle", "joblib", "platformdirs", "scipy", "asammdf", "yaml", "can", "sitecustomize")


@pytest.fixture
def hostile(tmp_path: Path) -> Path:
    """A folder with a stranger's modules, settings and programs; ``ran`` appears in it where one of them was executed."""
    folder = tmp_path / "stranger"
    folder.mkdir()
    mark = f"open({str(folder / 'ran')!r}, 'a').write(__name__ + '\\n')\n"
    for name in STRANGERS:
        (folder / f"{name}.py").write_text(mark)
    (folder / "ip").write_text(f"#!/bin/sh\necho ip >> {folder / 'ran'}\n")
    (folder / "ip").chmod(0o755)
    (folder / ".numba_config.yaml").write_bytes(b"\xff\x00: [")
    (folder / "matplotlibrc").write_bytes(b"\xff\xfe\x00 garbled")
    return folder


def executed(folder: Path) -> str:
    return (folder / "ran").read_text() if (folder / "ran").exists() else ""


def beltcomm(folder: Path, *words: str, **more: str) -> subprocess.CompletedProcess[str]:
    command = [str(Path(sys.executable).with_name("beltcomm")), *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, env={**os.environ, **more}, stdin=subprocess.DEVNULL)


def python(folder: Path, text: str, **more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-P", "-c", text], cwd=folder, capture_output=True, text=True, env={**os.environ, **more})


def test_importing_an_mdf_file_executes_nothing_that_lies_there(hostile: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    t_s = np.arange(200) * 1e-3
    with asammdf.MDF() as file:
        file.append([asammdf.Signal(samples=np.sin(40.0 * t_s), timestamps=t_s, name="torque_nm", unit="Nm")])
        file.save(hostile / "log.mf4")
    done = python(
        hostile,
        "from pathlib import Path; from beltcomm.foreign import optional_formats as f; print(sorted(f.read_mdf(Path('log.mf4')).columns))",
        PYTHONPATH=os.pathsep.join(filter(None, ["", os.environ.get("PYTHONPATH")])),  # an empty entry is the working directory
    )
    assert done.stdout == "['time', 'torque_nm']\n", done.stderr
    assert executed(hostile) == ""


def test_the_processes_of_a_study_execute_nothing_that_lies_there(hostile: Path) -> None:
    text = (
        "from beltcomm.study.workers import answers; from beltcomm.talk import Silence\n"
        "print(sorted(answers(abs, [-1, -2, -3], workers=2, scheduler=None, talk=Silence())))"
    )
    done = python(hostile, text)
    assert done.stdout == "[1, 2, 3]\n", done.stderr
    assert executed(hostile) == ""


@pytest.mark.parametrize(
    "module", quick(["compiled", "simulate.kernels.vectors", "simulate.kernels.fast_math", "simulate.kernels.vectors"], 1)
)
def test_numba_takes_no_settings_from_there(hostile: Path, tmp_path: Path, module: str) -> None:
    places = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "NUMBA_CACHE_DIR": ""}
    text = (
        f"import beltcomm.{module}, numba, numpy as np\n"
        "from beltcomm.control.cascade_kernel import reset_state\n"
        "state = np.ones(7); reset_state(state, 0.5); print(numba.njit(lambda x: x + 1)(1), numba.config.CACHE_DIR == '')"
    )
    for settings in (b"\xff\x00: [", f"cache_dir: {hostile / 'foreign'}\n".encode()):
        (hostile / ".numba_config.yaml").write_bytes(settings)
        done = python(hostile, text, **places)
        assert done.stdout == "2 True\n", done.stderr
    assert not (hostile / "foreign").exists()


def test_matplotlib_takes_no_settings_from_there(hostile: Path, tmp_path: Path) -> None:
    text = "from beltcomm.report import style; import matplotlib; print(matplotlib.rcParams['axes.facecolor'], matplotlib.get_cachedir())"
    for settings in (b"\xff\xfe\x00 garbled", b"axes.facecolor: red\n"):
        (hostile / "matplotlibrc").write_bytes(settings)
        done = python(hostile, text, XDG_CACHE_HOME=str(tmp_path), MPLCONFIGDIR=str(tmp_path / "beltcomm"))
        assert done.stdout == f"white {tmp_path / 'beltcomm'}\n", done.stderr


def test_the_module_called_as_one_forgets_where_it_stands(hostile: Path) -> None:
    (hostile / "runpy.py").unlink()  # which Python itself imports first
    (hostile / "platformdirs.py").write_text(f"open({str(hostile / 'ran')!r}, 'a')\n")
    done = subprocess.run([sys.executable, "-m", "beltcomm", "effects"], cwd=hostile, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "cogging" in done.stdout
    assert executed(hostile) == ""


def test_programs_are_looked_for_in_places_and_not_wherever_one_stands(hostile: Path) -> None:
    done = beltcomm(hostile, "doctor", PATH=f":.:{os.environ['PATH']}")
    assert done.returncode in (0, 1), done.stderr
    assert executed(hostile) == ""


def test_only_one_module_starts_processes() -> None:
    package = Path(isolation.__file__).parent
    others = [*package.rglob("*.py"), *(package.parent / "adapters").rglob("*.py")]
    starts = ("subprocess.run(", "subprocess.Popen(", "subprocess.check", "os.system", "os.popen", "os.exec", "os.spawn", "os.fork")
    found = {path.name for path in others for word in starts if word in path.read_text(encoding="utf-8")}
    assert found == {"isolation.py"}


@pytest.mark.parametrize("entries", [".", "", os.pathsep, f"/nonexistent{os.pathsep}"])
def test_an_entry_of_pythonpath_that_means_here_is_none(hostile: Path, entries: str) -> None:
    (hostile / "sitecustomize.py").unlink()  # which Python itself imports first
    done = beltcomm(hostile, "effects", PYTHONPATH=entries)
    assert done.returncode == 0, done.stderr
    assert executed(hostile) == ""


def test_settings_of_the_environment_that_cannot_be_end_no_command(tmp_path: Path) -> None:
    wrong = {"MPLBACKEND": "nothing", "NUMBA_NUM_THREADS": "0"}
    done = python(tmp_path, "import beltcomm.report, beltcomm.machine_code, os; print(os.environ['MPLBACKEND'])", **wrong)
    assert (done.stdout, done.returncode) == ("nothing\n", 0), done.stderr
