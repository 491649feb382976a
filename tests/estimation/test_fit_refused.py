"""What a simulation can have and a fit cannot is refused by name, before a log is read."""

import pytest

from data_io.values import LogError
from identify.base.errors import FitError
from identify.identification import fit
from identify.scene import Scene

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}


def _scene(effects, **parameters):
    document = {"effects": ["inertia", *effects], "rig": RIG, "logs": [{"path": "log.csv", "drive_speed": 1e-3}]}
    return Scene.from_document(document | ({"parameters": parameters} if parameters else {}))


@pytest.mark.parametrize(
    ("effects", "parameters", "says"),
    [
        (["force_sensor"], {"averaging_time": "1 ms"}, "averaging_time is 0.001 s.*leave it at 0.*sensor_lag"),
    ],
)
def test_it_is_refused_by_name(effects, parameters, says):
    with pytest.raises(FitError, match=says):
        fit(_scene(effects, **parameters))


@pytest.mark.parametrize(
    ("effects", "parameters"),
    [
        (["friction_heterogeneity"], {"field_sd": 0.0, "strength_sd": 0.0, "loading_sd": 0.0}),
        (["friction_heterogeneity"], {}),  # which asks for the estimator of uneven records
        (["force_sensor"], {}),
    ],
)
def test_at_its_null_values_it_is_let_pass(effects, parameters):
    with pytest.raises(LogError, match=r"log\.csv"):  # the next thing that is missing
        fit(_scene(effects, **parameters))


FIXED = {"mu_s": 0.6, "mu_k0": 0.45, "delta_mu_k": -0.1, "a": 500.0, "D": 40e-6, "t_cr": 0.5}
LAWS = ["contact_ageing", "velocity_weakening"]


def test_a_fit_in_which_nothing_is_free_is_refused():
    held = {name: {"fixed": value} for name, value in FIXED.items()}
    with pytest.raises(FitError, match=r"fixes or ties every parameter.*--preview"):
        fit(_scene(LAWS, **held))
    with pytest.raises(LogError, match=r"log\.csv"):  # the next thing that is missing
        fit(_scene(LAWS, **held | {"t_cr": {"start": 0.5}}))


def test_a_fit_without_inertia_is_refused_by_name():
    document = {"effects": ["contact_ageing"], "rig": RIG, "logs": [{"path": "log.csv", "drive_speed": 1e-3}]}
    with pytest.raises(FitError, match="inertia is off"):
        fit(Scene.from_document(document))
