"""Named parameters: fixed point, integral time, read back, put back; and their conversion to controller values."""

from __future__ import annotations

import math

import pytest

from adapters.stub_node import StubBus, StubNode
from beltcomm.control import Cascade, Feedforward, Prefilter
from beltcomm.drive.objects import ObjectValue
from beltcomm.drive.parameters import GAIN_NAMES, cascade_to_parameters, parameters_to_cascade
from beltcomm.errors import DriveError, ObjectRefused, Refused, UsageError
from beltcomm_adapters.gains import Parameters, structure_of
from beltcomm_adapters.link import Link
from beltcomm_adapters.profiles import load_profile
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.sdo import SdoObjects

SCALING = Scaling(1e-4, 1e-4, 1e-4, 1e-3, 65536, 1.0, 2.0)


@pytest.fixture
def festo():
    """Gains of a CMMP-AS as drive-protocols.md lists its defaults."""
    node = StubNode()
    for (index, sub), value in {(0x60F9, 1): 256, (0x60F9, 2): 2000, (0x60F9, 4): 400, (0x60FB, 1): 102}.items():
        node.objects[index, sub] = ("<H", value)
    return node


@pytest.fixture
def parameters(festo):
    with StubBus(festo) as bus:
        found = Parameters(SdoObjects(Link(bus, bus.clock, 1)), load_profile("cmmp-as"), SCALING)
        found.calibrate({"kp_nm_s_rad": 0.02 / 256, "ki_nm_rad": 1e-6, "kpp_1_s": 10 / 256})
        yield found


def test_defaults_in_si(parameters):
    # gain 1.0 = 256 = 0.02 N m s/rad and 10 1/s; T_n 2 ms, filter 0.4 ms
    assert parameters.read(["kp_nm_s_rad", "ki_nm_rad", "kpp_1_s", "velocity_filter_s"]) == pytest.approx(
        {"kp_nm_s_rad": 0.02, "ki_nm_rad": 0.02 / 0.002, "kpp_1_s": 10 * 102 / 256, "velocity_filter_s": 400e-6}
    )


def test_a_write_returns_what_the_fixed_point_holds(festo, parameters):
    stored = parameters.write({"ki_nm_rad": 4.0, "kp_nm_s_rad": 0.08, "kpp_1_s": 10.91, "velocity_filter_s": 2e-3})
    assert (festo.get(0x60F9, 1), festo.get(0x60F9, 2), festo.get(0x60FB, 1), festo.get(0x60F9, 4)) == (1024, 20000, 279, 2000)
    assert stored == pytest.approx({"ki_nm_rad": 4.0, "kp_nm_s_rad": 0.08, "kpp_1_s": 279 / 25.6, "velocity_filter_s": 2e-3})


def test_k_i_stays_when_only_k_p_is_written(festo, parameters):
    parameters.write({"kp_nm_s_rad": 0.04})
    assert (festo.get(0x60F9, 1), festo.get(0x60F9, 2)) == (512, 4000)
    assert parameters.read(["ki_nm_rad"])["ki_nm_rad"] == pytest.approx(10.0)


def test_a_backup_written_back_changes_nothing(festo, parameters):
    festo.put(0x60F9, 1, 777)
    festo.put(0x60F9, 2, 1234)
    before = dict(festo.objects)
    parameters.write(parameters.read(parameters.names))
    assert festo.objects == before


@pytest.mark.parametrize(
    ("values", "bounds"),
    [
        ({"kp_nm_s_rad": 0.0005}, "to 1.28;"),
        ({"ki_nm_rad": 0.1}, "0.625 to 2e"),
        ({"ki_nm_rad": 0.0}, "0.625 to 2e"),
        ({"torque_limit_nm": 0.5}, "1 to 65.5"),
    ],
)
def test_a_value_outside_the_range_is_refused_with_the_range(festo, parameters, values, bounds):
    with pytest.raises(UsageError, match=bounds):
        parameters.write(values)
    assert festo.written == []


def test_unknown_names_list_the_known_ones(parameters):
    with pytest.raises(UsageError, match=r"no parameter ff_inertia_kg_m2; it has kp_nm_s_rad, ki_nm_rad"):
        parameters.write({"ff_inertia_kg_m2": 1e-4})
    with pytest.raises(UsageError, match="no parameter x"):
        parameters.read(["x"])


def test_everything_is_put_back_when_one_write_is_refused(festo, parameters):
    before = dict(festo.objects)
    festo.refuse[0x60FB, 1] = 0x08000022
    with pytest.raises(ObjectRefused, match=r"kpp_1_s.*60FBh:1"):
        parameters.write({"kp_nm_s_rad": 0.04, "kpp_1_s": 5.0})
    assert festo.objects == before


def test_everything_is_put_back_when_another_value_comes_back(festo, parameters):
    before = dict(festo.objects)
    festo.stuck_objects.add((0x60FB, 1))
    with pytest.raises(DriveError, match=r"stored 102 instead of 128 for kpp_1_s \(object 60FBh:1"):
        parameters.write({"kp_nm_s_rad": 0.04, "kpp_1_s": 5.0})
    assert festo.objects == before


def test_limits_are_torque_and_speed(festo, parameters):
    festo.put(0x6080, 0, 3000)
    assert parameters.read(["torque_limit_nm", "speed_limit_rad_s"]) == pytest.approx(
        {"torque_limit_nm": 3.0, "speed_limit_rad_s": 100 * math.pi}
    )


def test_the_structure_tells_steps_and_bounds_of_the_fixed_point():
    structure = structure_of(load_profile("cmmp-as"), 1e-3)
    assert structure.prefilters == ("none",)
    assert not structure.torque_feedforward
    assert structure.steps["kp_nm_s_rad"] == 0.02 / 256
    assert structure.lowest["kp_nm_s_rad"] == pytest.approx(20 / 256 * 0.02)
    assert structure.highest["integral_time_s"] == pytest.approx(0.032)
    assert structure_of(load_profile("reference"), 1e-3).steps == {}


def test_cascade_and_parameters_are_each_others_inverse():
    cascade = Cascade(0.104, 1.67, 8.2, 2e-3, Prefilter("notch", 123.1, 4.6), Feedforward(2e-3, 2.5e-3, 0.125, -0.1, 1.0), True)
    parameters = cascade_to_parameters(cascade)
    assert tuple(parameters) == GAIN_NAMES
    assert parameters["prefilter_kind"] == 1.0
    assert parameters_to_cascade(parameters) == cascade


def test_a_drive_without_prefilter_and_feedforward_runs_a_plain_cascade():
    gains = {"kp_nm_s_rad": 0.02, "ki_nm_rad": 10.0, "kpp_1_s": 4.0, "velocity_filter_s": 4e-4, "torque_limit_nm": 1.0}
    plain = parameters_to_cascade(gains)
    assert plain == Cascade(0.02, 10.0, 4.0, 4e-4, Prefilter(), Feedforward(velocity=0.0), filter_reference=False)


def test_incomplete_or_unknown_parameters_are_named():
    with pytest.raises(UsageError, match="ki_nm_rad, kpp_1_s"):
        parameters_to_cascade({"kp_nm_s_rad": 1.0, "velocity_filter_s": 0.0})
    with pytest.raises(UsageError, match="prefilter_kind 3"):
        parameters_to_cascade({**cascade_to_parameters(Cascade(1, 1, 1, 1)), "prefilter_kind": 3.0})


def test_a_gain_of_unknown_meaning_is_not_changed_but_put_back(festo):
    with StubBus(festo) as bus:
        parameters = Parameters(SdoObjects(Link(bus, bus.clock, 1)), load_profile("cmmp-as"), SCALING)
        assert parameters.uncalibrated == {"kp_nm_s_rad", "ki_nm_rad", "kpp_1_s"}
        found = parameters.read(parameters.names)
        with pytest.raises(Refused, match=r"kp_nm_s_rad \(60F9h:1\).*beltcomm calibrate"):
            parameters.write({"kp_nm_s_rad": 0.04})
        assert festo.written == []
        parameters.write({"velocity_filter_s": 1e-3, "torque_limit_nm": 2.0})  # these are known
        festo.put(0x60F9, 1, 20)  # a test value that nobody has put back
        parameters.write(found)
        assert festo.get(0x60F9, 1) == 256
        parameters.calibrate({"kp_nm_s_rad": 1e-4})
        assert parameters.read(["kp_nm_s_rad"]) == {"kp_nm_s_rad": pytest.approx(0.0256)}
        parameters.write({"kp_nm_s_rad": 0.01, "ki_nm_rad": 0.01 / 0.002})  # the integral time stays as it is
        assert (festo.get(0x60F9, 1), festo.get(0x60F9, 2)) == (100, 2000)
        with pytest.raises(Refused, match="kpp_1_s"):
            parameters.write({"kpp_1_s": 1.0})


def test_a_real_number_of_a_file_has_more_digits_than_the_drive(festo):
    festo.objects[0x2100, 1] = ("<f", 0.0)
    with StubBus(festo) as bus:
        parameters = Parameters(SdoObjects(Link(bus, bus.clock, 1)), load_profile("cmmp-as"), SCALING)
        parameters.write_objects([ObjectValue(0x2100, 1, "real32", 0.0873164)])
        assert festo.get(0x2100, 1) == pytest.approx(0.0873164, rel=1e-6)
