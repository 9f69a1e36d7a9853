"""The catalogue: defaults of EQUATIONS' table, what is refused, and how the page sees it."""

import numpy as np
import pytest
from pydantic import ValidationError

from snakeslam.errors import InputError
from snakeslam.gaits import serpenoid
from snakeslam.gaits.catalogue import GAITS, GaitSettings, resolve
from snakeslam.robot.model import PRESETS

SIM, PROTOTYPE = PRESETS["sim35"], PRESETS["orthogonal24"]


def test_the_defaults_are_those_of_the_table():
    k = 2 * np.pi / 16
    serpentine = resolve(GaitSettings(), SIM).shape
    assert serpentine.k_o == pytest.approx(2 * np.pi / 20)
    assert serpentine.amplitude_o == pytest.approx(serpenoid.amplitude_from_alpha(0.3 * np.pi, 20))
    assert serpentine.amplitude_e == 0.0
    assert resolve(GaitSettings(), PROTOTYPE).shape.k_o == pytest.approx(k)
    expected = {
        "sidewinding": (0.5, 0.25, k, k, 1),
        "arc_rolling": (0.15, 0.15, 0, 0, 1),
        "helix_rolling": (0.3, 0.3, k, k, 1),
        "pedal": (0.6, 0.2, k, 2 * k, 2),
    }
    for name, (a_o, a_e, k_o, k_e, harmonic_e) in expected.items():
        shape = resolve(GaitSettings(name=name), SIM).shape
        assert (shape.amplitude_o, shape.amplitude_e) == pytest.approx((a_o, a_e), rel=0.003)
        assert (shape.k_o, shape.k_e, shape.harmonic_e) == pytest.approx((k_o, k_e, harmonic_e))
        assert shape.delta == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("model", [SIM, PROTOTYPE])
@pytest.mark.parametrize("name", list(GAITS))
def test_every_slider_of_the_page_is_valid_at_both_ends_and_at_its_default(model, name):
    for parameter in GAITS[name].parameters_for(model):
        assert parameter.minimum <= parameter.default <= parameter.maximum
        for value in (parameter.minimum, parameter.default, parameter.maximum):
            GaitSettings(name=name, **{parameter.key: value})
    assert resolve(GaitSettings(name=name), model).omega == pytest.approx(2 * np.pi / 4)


def test_an_amplitude_in_degrees_is_the_yaw_joints():
    assert resolve(GaitSettings(name="helix_rolling", amplitude_deg=10), SIM).shape.amplitude_e == np.deg2rad(10)
    assert resolve(GaitSettings(amplitude_deg=30), SIM).shape.amplitude_o == np.deg2rad(30)
    with pytest.raises(InputError, match=r"gait.amplitude_deg.*one of the two"):
        resolve(GaitSettings(amplitude_deg=30, alpha_pi=0.2), SIM)


def test_what_the_joints_cannot_do_is_refused_with_what_they_can():
    with pytest.raises(InputError, match=r"would bend 132 deg in a turn.*at most 95 deg"):
        resolve(GaitSettings(alpha_pi=0.7, wavelength_joints=12), SIM)
    with pytest.raises(InputError, match=r"gait.period_s: 1.00 s is too fast .*allowed: 1.\d+ s or longer"):
        resolve(GaitSettings(alpha_pi=0.5, period_s=1), SIM)
    for bad in ({"period_s": -1}, {"period_s": 0}, {"alpha_pi": 2}, {"name": "walking"}, {"alpha": 1}):
        with pytest.raises(ValidationError):
            GaitSettings(**bad)


def test_turning_offsets_the_yaw_joints_or_tapers_and_leaves_rolling_alone():
    assert resolve(GaitSettings(), SIM, turn=1.0).shape.beta_o > 0.0
    assert resolve(GaitSettings(name="sidewinding"), SIM, turn=1.0).shape.taper < 0.0
    for name, entry in GAITS.items():
        straight, turned = (resolve(GaitSettings(name=name), SIM, turn) for turn in (0.0, 1.0))
        assert (straight != turned) == entry.steers
        assert ("cannot turn" in entry.summary) == (not entry.steers)
