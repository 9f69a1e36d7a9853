"""The sentence about parameter sets that barely advance."""

import pytest

from snakeslam.gaits.catalogue import GaitSettings, resolve
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]


def notice(**gait):
    return resolve(GaitSettings(**gait), MODEL).notice


def test_at_seven_tenths_pi_the_share_of_the_wave_is_told():
    assert notice(alpha_pi=0.7, period_s=8) == (
        "At a winding angle of 0.70 pi even an ideal snake moves forward only 11 % of its wave: "
        "expect almost no progress"
    )


def test_a_quarter_of_the_wave_is_the_border():
    """J0 is .25 at 1.955 rad = .622 pi."""
    assert notice(alpha_pi=0.62, period_s=8) is None
    said = notice(alpha_pi=0.625, period_s=8)
    assert said is not None
    assert "24 %" in said


def test_the_amplitude_says_the_same_as_the_angle():
    """77.9 deg at 20 joints is .7 pi."""
    assert notice(amplitude_deg=77.9, wavelength_joints=20, period_s=8) == notice(alpha_pi=0.7, period_s=8)


@pytest.mark.parametrize("wavelength", [30, 40, 60])
def test_beyond_the_first_zero_nothing_is_promised(wavelength):
    """A long wave with a large amplitude winds further than the angle's own limit: J0 may be large again there."""
    said = notice(amplitude_deg=77.9, wavelength_joints=wavelength, period_s=8)
    assert said is not None
    assert "no progress" in said
    assert "%" not in said


@pytest.mark.parametrize("name", ["sidewinding", "arc_rolling", "helix_rolling", "pedal"])
def test_other_gaits_have_no_such_notice(name):
    assert notice(name=name) is None
