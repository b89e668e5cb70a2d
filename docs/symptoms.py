"""What an effect looks like: one experiment per effect, with it and without it; ``docs/make.py`` draws them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache

from experiments import (
    RATIO,
    Symptom,
    by_angle,
    calm,
    having,
    move,
    response,
    response_by_amplitude,
    response_by_place,
    response_by_swing,
    reversals,
    rig,
    scale,
    session,
    slippery,
    strokes,
    sweep,
    without,
)

from beltcomm.model import Model, build_model, load_plant


@cache
def shaft_rig(*effects: str) -> Model:
    """A motor that turns a load through a shaft."""
    values = {
        "motor.inertia": 7.2e-5,
        "transmission.ratio": RATIO,
        "viscous.damping": 2.53e-3,
        "coulomb.level": 0.06,
        "elastic_shaft.stiffness": 6.0,
        "elastic_shaft.damping": 0.01 if effects == ("elastic_shaft",) else 0.03,
        "load.inertia": 1.2e-4,
        "viscous_load.damping": 4e-3,
        "coulomb_load.level": 0.05,
    }
    names = ("viscous", "coulomb", *effects)
    chosen = {key: value for key, value in values.items() if key.split(".")[0] in ("motor", "transmission", *names)}
    if "elastic_shaft" in names:
        chosen["load.inertia"] = values["load.inertia"]
    else:
        chosen["motor.inertia"] += values["load.inertia"]
    return build_model("shaft", names, chosen, base_bodies=("motor",))


def with_rigid_load() -> Model:
    """The motor of :func:`shaft_rig` with half as much inertia again that moves with it."""
    alone = shaft_rig()
    values = {name: alone[name] for name in alone.parameters} | {"cart.mass": 0.5 * alone["motor.inertia"] / RATIO**2}
    return build_model("rigid", ("rigid_load", "viscous", "coulomb"), values, base_bodies=("motor",))


def in_sections(with_coupling: bool) -> Model:
    """The three masses of the data sheets; without the coupling the pulley turns with the motor."""
    model = load_plant("egc_70").model
    if with_coupling:
        return model
    inertia = model["motor.inertia"] + model["driving_pulley.inertia"]
    return model.without_effect("coupling").with_values({"motor.inertia": inertia})


def calm_sections() -> Model:
    """The same with a belt that damps strongly, without the coupling."""
    return in_sections(False).with_values({"belt_sections.specific_damping": 500.0})


def with_spans(model: Model) -> Model:
    """The rig with the lengths of its belt."""
    return having("belt_spans", model.without_effect("belt_stiffness"), specific_stiffness=5.2e4, pulley_distance=0.79, offset=0.05)


def all_at_motor() -> Model:
    """The rig with the friction of its carriage at the motor."""
    model = without("cart_friction")
    return model.with_values({"coulomb.level": model["coulomb.level"] + RATIO * rig()["cart_friction.level"]})


def rubbing(name: str, amount: float) -> Model:
    """The rig with an amount of friction at a place or at low speed, all of it at the motor or all of it at the carriage."""
    owner = name.removesuffix("_cart")
    model = having(owner, all_at_motor(), amount=0.0, **({"place": 0.25} if owner == "friction_position" else {}))
    return model.with_values({f"{owner}.amount": amount}) if name == owner else having(name, model, amount=amount)


#: By effect; effects that share law and parameters with another share its picture.
SYMPTOMS: Mapping[str, Callable[[], Symptom]] = {
    "rigid_load": lambda: response(shaft_rig(), with_rigid_load()),
    "other_load": lambda: response(rig(), rig().with_values({"cart.mass": 1.6 * rig()["cart.mass"]})),
    "other_inertia": lambda: response(shaft_rig(), shaft_rig().with_values({"motor.inertia": 1.6 * shaft_rig()["motor.inertia"]})),
    "belt_stiffness": lambda: response(rig().with_values({"belt_stiffness.stiffness": 1e8, "belt_damping.damping": 2000.0}), rig()),
    "belt_spans": lambda: response_by_place(rig(), with_spans(rig())),
    "stiffness_position": lambda: response_by_place(
        rig(), having("stiffness_position", share=0.8, offset=0.05, pulley_distance=0.79, middle=0.25)
    ),
    "belt_sections": lambda: response(
        with_spans(rig()),
        having(
            "belt_sections",
            without("belt_stiffness", "belt_damping"),
            specific_stiffness=5.2e4,
            pulley_distance=0.79,
            offset=0.05,
            specific_damping=5.0,
            mass=0.3,
        ),
    ),
    "end_pulley": lambda: response(rig(), having("end_pulley", share=0.3, mass=0.4)),
    "coupling": lambda: response(in_sections(False), in_sections(True).with_values({"coupling.stiffness": 40.0})),
    "elastic_shaft": lambda: response(shaft_rig(), shaft_rig("elastic_shaft")),
    "payload_mode": lambda: response(
        rig(),
        having("payload_mode", rig().with_values({"cart.mass": 9.44}), mass=4.0, stiffness=4.0 * (2 * math.pi * 9.0) ** 2, damping=25.0),
    ),
    "belt_damping": lambda: response(rig().with_values({"belt_damping.damping": 5.0}), rig().with_values({"belt_damping.damping": 60.0})),
    "backlash": lambda: response_by_amplitude(slippery(), having("backlash", slippery(), gap=2e-4), 0.4, 1.5),
    "belt_slack": lambda: response_by_amplitude(slippery(), having("belt_slack", slippery(), limit=4e-4, share=0.5), 0.2, 1.5),
    "viscous": lambda: sweep(calm().without_effect("viscous"), calm()),
    "viscous_cart": lambda: sweep(calm(), having("viscous_cart", calm(), damping=12.0)),
    "viscous_end_pulley": lambda: sweep(calm_sections(), having("viscous_end_pulley", calm_sections(), damping=12.0)),
    "viscous_load": lambda: sweep(shaft_rig("elastic_shaft"), shaft_rig("elastic_shaft", "viscous_load")),
    "viscous_asymmetry": lambda: sweep(calm(), having("viscous_asymmetry", calm(), share=0.3)),
    "warmup": lambda: session(calm(), having("warmup", calm(), amount=0.5, time=60.0)),
    "quadratic_drag": lambda: sweep(calm(), having("quadratic_drag", calm(), factor=8.0)),
    "coulomb": lambda: sweep(calm().without_effect("coulomb"), calm()),
    "cart_friction": lambda: response_by_swing(all_at_motor(), rig()),
    "coulomb_end_pulley": lambda: sweep(calm_sections(), having("coulomb_end_pulley", calm_sections(), level=3.0)),
    "coulomb_load": lambda: sweep(shaft_rig("elastic_shaft"), shaft_rig("elastic_shaft", "coulomb_load")),
    "stribeck": lambda: sweep(calm(), having("stribeck", calm(), amount=0.04, speed_scale=2.5), 200),
    "stribeck_cart": lambda: response_by_swing(rubbing("stribeck", amount=0.25), rubbing("stribeck_cart", amount=0.25 / RATIO)),
    "friction_dip": lambda: sweep(
        calm().with_values({"coulomb.level": 0.0875}),
        having("friction_dip", calm().with_values({"coulomb.level": 0.0475}), amount=0.04, speed_scale=2.5),
        200,
    ),
    "friction_freeform": lambda: sweep(
        calm(),
        having(
            "friction_freeform",
            calm(),
            fastest=80.0,
            forward_1=0.03,
            forward_2=0.01,
            forward_3=-0.01,
            forward_4=0.02,
            forward_5=0.05,
            backward_1=0.02,
            backward_2=0.02,
            backward_3=0.0,
            backward_4=-0.02,
            backward_5=0.02,
        ),
    ),
    "holding_brake": lambda: strokes(calm(), having("holding_brake", calm(), sine=0.015, cosine=0.01)),
    "load_friction": lambda: move(calm(), having("load_friction", calm(), share=0.12)),
    "friction_position": lambda: strokes(calm(), having("friction_position", calm(), amount=0.04, place=0.27, width=0.03)),
    "friction_position_cart": lambda: response_by_swing(
        rubbing("friction_position", amount=0.1), rubbing("friction_position_cart", amount=0.1 / RATIO)
    ),
    "presliding": lambda: reversals(calm(), having("presliding", calm(), length=4e-5)),
    "presliding_cart": lambda: reversals(
        calm().with_values({"coulomb.level": 0.02, "cart_friction.level": 8.0}),
        having("presliding_cart", calm().with_values({"coulomb.level": 0.02, "cart_friction.level": 8.0}), length=6e-5),
    ),
    "tilt": lambda: strokes(calm(), having("tilt", calm(), angle=0.03)),
    "constant_offset": lambda: strokes(calm(), having("constant_offset", calm(), torque=0.04)),
    "cable_chain": lambda: strokes(calm(), having("cable_chain", calm(), rate=15.0, offset=-3.0)),
    "unbalance": lambda: by_angle(
        shaft_rig(),
        having("unbalance", shaft_rig(), sine=0.05, cosine=0.02),
        {"slowly": (0.1, 0.0)},
        "a motor that turns slowly: torque over its angle",
    ),
    "cogging": lambda: strokes(calm(), having("cogging", calm(), order=12.0, sine=0.012, cosine=0.009), 0.02, 0.2, 0.3),
    "tooth_ripple": lambda: strokes(calm(), having("tooth_ripple", calm(), teeth=26.0, sine=0.01, cosine=0.006), 0.02, 0.2, 0.26),
    "travel_ripple": lambda: strokes(calm(), having("travel_ripple", calm(), period=0.01, sine=0.8, cosine=0.5), 0.02, 0.2, 0.3),
    "torque_ripple": lambda: by_angle(
        calm(),
        having("torque_ripple", calm(), order=6.0, sine=0.06, cosine=0.03),
        {"at 50 mm/s": (0.05, 0.0), "at 6 m/s²": (0.0, 6.0)},
        "torque over the motor angle, with little torque and with much",
    ),
    "torque_saturation": lambda: move(calm(), having("torque_saturation", calm(), loss=0.12, peak=3.2)),
    "dead_time": lambda: response(rig(), having("dead_time", time=1.5e-3)),
    "current_lag": lambda: response(rig(), having("current_lag", time=1.5e-3)),
    "measurement_lag": lambda: move(calm(), having("measurement_lag", calm(), time=8e-3)),
    "pulley_eccentricity": lambda: by_angle(
        calm(),
        having("pulley_eccentricity", calm(), sine=0.02, cosine=0.01),
        {"at 50 mm/s": (0.05, 0.0), "at 6 m/s²": (0.0, 6.0)},
        "torque over the motor angle, with little load and with much",
    ),
    "pulley_eccentricity_2": lambda: by_angle(
        calm(),
        having("pulley_eccentricity_2", calm(), sine=0.01, cosine=0.005),
        {"at 50 mm/s": (0.05, 0.0), "at 6 m/s²": (0.0, 6.0)},
        "torque over the motor angle, with little load and with much",
    ),
    "feed_constant": lambda: scale(having("feed_constant", error=0.004)),
    "encoder_eccentricity": lambda: by_angle(
        calm(),
        having("encoder_eccentricity", calm(), sine=0.004, cosine=0.002),
        {"at 0.5 m/s": (0.5, 0.0), "at 1 m/s": (1.0, 0.0)},
        "torque over the motor angle at two speeds",
    ),
    "encoder_eccentricity_2": lambda: by_angle(
        calm(),
        having("encoder_eccentricity_2", calm(), sine=0.001, cosine=0.0005),
        {"at 0.5 m/s": (0.5, 0.0), "at 1 m/s": (1.0, 0.0)},
        "torque over the motor angle at two speeds",
    ),
    "encoder_interpolation": lambda: by_angle(
        calm(),
        having("encoder_interpolation", calm(), lines=512.0, sine=8e-5, cosine=6e-5, sine_2=4e-5),
        {"at 5 mm/s": (0.005, 0.0), "at 50 mm/s": (0.05, 0.0)},
        "torque over the motor angle at two speeds, ten lines and a hundred",
        300,
    ),
}
