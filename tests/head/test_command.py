"""From the operator's wish for the head to settings, or one clear line."""

import pytest

from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import GaitSettings, resolve
from snakeslam.head.catalogue import HEAD_CATALOGUE
from snakeslam.head.command import check_steering, commanded_head
from snakeslam.head.laws import check
from snakeslam.head.neck import most_neck_joints
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import HeadCommand
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]
GAIT = resolve(GaitSettings(), MODEL)


def wish(**command):
    return commanded_head(HeadCommand(0, **command), HeadSettings(controller="none", neck_joints=5), MODEL, GAIT)


def test_what_is_not_asked_for_stays():
    assert wish() == HeadSettings(controller="none", neck_joints=5)
    assert wish(controller="none") == HeadSettings(controller="none", neck_joints=5)
    assert wish(neck_joints=4) == HeadSettings(controller="none", neck_joints=4)


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ({"controller": "steady"}, "head.controller"),
        ({"neck_joints": 1}, "head.neck_joints"),
        ({"neck_joints": 13}, "head.neck_joints"),
        ({"turn_by_deg": float("nan")}, "head.turn_by_deg.*-180 to 180"),
        ({"turn_by_deg": 200.0}, "head.turn_by_deg.*-180 to 180"),
        ({"turn_by_deg": 15.0}, "head.turn_by_deg.*no line to turn.*predictive"),
    ],
)
def test_a_wrong_wish_gets_one_line(command, text):
    with pytest.raises(InputError, match=text) as caught:
        wish(**command)
    assert "\n" not in str(caught.value)


def test_only_the_predictive_controller_steers():
    check_steering(-45.0, "predictive")
    for name in ("none", "direction", "position"):
        with pytest.raises(InputError, match="no line to turn"):
            check_steering(15.0, name)


def test_a_neck_leaves_a_body():
    """Half the joints yaw: a neck of so many would be the whole robot."""
    short = PRESETS["orthogonal24"]
    assert 2 * most_neck_joints(short) < short.joint_count
    check(HeadSettings(neck_joints=most_neck_joints(short)), short, resolve(GaitSettings(), short))


def test_the_catalogue_has_one_sentence_for_each_controller():
    assert list(HEAD_CATALOGUE) == ["none", "direction", "position", "predictive"]
    for name, entry in HEAD_CATALOGUE.items():
        assert entry.name == name
        assert entry.summary.endswith(".")
