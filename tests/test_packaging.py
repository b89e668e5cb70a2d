"""The wheel: complete, and working from another folder with a read-only site-packages; python-can loaded without pandas."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from beltcomm import __version__

CHECKOUT = Path(__file__).parent.parent
HEAVY = ("numpy", "numba", "scipy", "can", "canopen", "ruckig", "matplotlib")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of this checkout, built without the network."""
    folder = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-build-isolation", "--no-deps", "--wheel-dir", str(folder), str(CHECKOUT))
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The wheel, installed into a site-packages of its own in which nobody may write."""
    folder = tmp_path_factory.mktemp("site")
    pip("install", "--no-deps", "--no-compile", "--target", str(folder), str(wheel))
    parts = [folder, *folder.rglob("*")]
    for part in parts:
        part.chmod(part.stat().st_mode & ~0o222)
    yield folder
    for part in parts:
        part.chmod(part.stat().st_mode | 0o200)


def pip(*words: str) -> None:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q", *words]
    subprocess.run(command, check=True, capture_output=True, text=True, stdin=subprocess.DEVNULL)


def run(site: Path, folder: Path, *words: str, home_is_writable: bool = True) -> str:
    """Output of a Python that finds beltcomm in ``site`` only, started in ``folder``, with an empty home and temporary files there."""
    home = folder / "home"
    home.mkdir(exist_ok=True)
    home.chmod(0o755 if home_is_writable else 0o555)
    keep = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "XDG_", "PYTHON", "COV_"))}
    packages = os.pathsep.join([str(site), sysconfig.get_path("purelib"), sysconfig.get_path("platlib")])
    # -S: no .pth files, so an editable install of the checkout stays out of sight
    command = [sys.executable, "-S", "-W", "error", *words]
    if os.geteuid() == 0:  # root may write into read-only folders, unless it gives that capability away
        command = ["setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override", *command]
    environment = keep | {"HOME": str(home), "TMPDIR": str(folder), "PYTHONPATH": packages}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_wheel_holds_both_packages_the_settings_and_the_types(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    for source, target in (("beltcomm", "beltcomm"), ("adapters/beltcomm_adapters", "beltcomm_adapters"), ("configs", "beltcomm/configs")):
        files = {
            path.relative_to(CHECKOUT / source) for path in (CHECKOUT / source).rglob("*") if path.suffix in (".py", ".yaml", ".typed")
        }
        assert {f"{target}/{file.as_posix()}" for file in files} <= held
    assert {"beltcomm/py.typed", "beltcomm_adapters/py.typed"} <= held
    assert {name.partition("/")[0] for name in held} == {"beltcomm", "beltcomm_adapters", f"beltcomm-{__version__}.dist-info"}


def test_the_installed_command_shows_its_help(site: Path, tmp_path: Path) -> None:
    assert "commission" in run(site, tmp_path, str(site / "bin" / "beltcomm"), "--help")


def test_starting_the_command_line_imports_nothing_heavy(site: Path, tmp_path: Path) -> None:
    program = f"import sys, beltcomm.cli.main; print([name for name in {HEAVY} if name in sys.modules])"
    assert run(site, tmp_path, "-c", program) == "[]\n"


def test_settings_and_adapters_are_found(site: Path, tmp_path: Path) -> None:
    program = """
import json
from beltcomm.axis import load_axis
from beltcomm.configfiles import find_config
from beltcomm.drive import find_adapters, open_drive
with open_drive("virtual", {"seed": 1}) as drive:
    position_rad = drive.read(["position_rad"])["position_rad"]
print(json.dumps({
    "axis": load_axis("egc-70-600").name, "file": str(find_config("axes", "egc-70-600")), "position_rad": position_rad,
    "adapters": {item.entry_point.partition(":")[0]: item.reason for item in find_adapters()},
}))
"""
    found = json.loads(run(site, tmp_path, "-c", program))
    assert found["file"] == str(site / "beltcomm" / "configs" / "axes" / "egc-70-600.yaml")
    assert found["axis"]
    assert isinstance(found["position_rad"], float)
    assert found["adapters"] == {"beltcomm_adapters.virtual": "", "beltcomm_adapters.canopen": "", "beltcomm_adapters.serial": ""}


@pytest.mark.examination
def test_the_installed_command_commissions_an_axis_within_its_times(site: Path, tmp_path: Path) -> None:
    """Everything from the wheel, nothing compiled before: 20 s on the machine, and less than two minutes of work for it.

    What is compiled is kept in the user's cache, for nobody may write beside the source.
    """
    before = used_s()
    said = run(site, tmp_path, str(site / "bin" / "beltcomm"), "commission", "--drive", "virtual:g_b", "--yes", "--quick", "--json")
    result = json.loads(said)
    assert result["verdict"]["passed"]
    assert result["machine_seconds"] <= 20.0
    assert used_s() - before < 120.0
    (folder,) = (tmp_path / "runs").iterdir()
    assert (tmp_path / result["run"]).samefile(folder)
    assert (folder / "designs" / "final.yaml").is_file()
    kept = {path.name.partition(".")[0].partition("_")[0] for path in (tmp_path / "home" / ".cache").rglob("*.nbc")}
    assert kept >= {"kernel", "cascade", "whitening"}  # composed from effects, and written in the package
    assert not list(site.rglob("*.nbc"))


def used_s() -> float:
    """Processor seconds of all finished children: wall time on a machine that has nothing else to do."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


RUN_KERNELS = """
from pathlib import Path
import numpy as np
from beltcomm.control import cascade_kernel
from beltcomm.model import load_plant
from beltcomm.simulate.kernels import first_root
from beltcomm.simulate.kernels.compose import kernel_for
for folder in (Path(cascade_kernel.__file__).parent, Path.home()):
    try:
        (folder / "draft").touch()
        print("writable")
    except PermissionError:
        print("read-only")
model = load_plant("g_b").model
kernel = kernel_for(model)
out = np.zeros(len(kernel.bodies))
kernel.forces(np.zeros_like(out), np.ones_like(out), model.vector(), 0.0, out)
state = np.ones(7)
cascade_kernel.reset_state(state, 0.5)
print(out.any(), state[0], first_root.value(np.array([1.0, 4.0]), 0.5))
"""


def test_kernels_compile_where_nothing_can_be_kept(site: Path, tmp_path: Path) -> None:
    """One composed from effects, one written in the package, one in lanes."""
    assert run(site, tmp_path, "-c", RUN_KERNELS, home_is_writable=False) == "read-only\nread-only\nTrue 0.5 3.0\n"
    assert [path.name for path in tmp_path.rglob("*")] == ["home"]


def test_the_container_is_made_of_what_the_package_needs() -> None:
    """What its file copies is there, and holds whatever the wheel is built from."""
    lines = (CHECKOUT / "Containerfile").read_text(encoding="utf-8").splitlines()
    copied = [word for line in lines if line.startswith("COPY ") for word in line.split()[1:-1]]
    assert all((CHECKOUT / name).exists() for name in copied)
    settings = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    forced = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert {*forced, settings["project"]["readme"], "beltcomm", "adapters", "LICENSE"} <= set(copied)


@pytest.mark.parametrize("first", ["beltcomm_adapters.canopen", "beltcomm.virtual.bus"])
def test_a_drive_is_reached_without_loading_pandas(first: str) -> None:
    told = f"import sys, {first}; print('can' in sys.modules, 'pandas' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "False"]
