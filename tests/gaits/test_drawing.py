"""The sampled body curve that the page draws: lengths, level ground, and a period that closes."""

import numpy as np
import pytest

from snakeslam.gaits.catalogue import GAITS, GaitSettings, resolve
from snakeslam.gaits.drawing import draw
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]


@pytest.mark.parametrize("name", list(GAITS))
def test_links_keep_their_length_and_the_lowest_point_is_on_the_ground(name):
    drawing = draw(resolve(GaitSettings(name=name), MODEL), MODEL)
    assert drawing.points.shape == (32, 37, 3)
    np.testing.assert_allclose(np.linalg.norm(np.diff(drawing.points, axis=1), axis=2), 1.0)
    np.testing.assert_allclose(drawing.points[..., 2].min(axis=1), 0.0, atol=1e-12)
    assert np.all(drawing.points[:, -1, 0] > drawing.points[:, 0, 0]), "the head is ahead of the tail"


@pytest.mark.parametrize("model", PRESETS.values(), ids=lambda model: model.name)
@pytest.mark.parametrize("name", list(GAITS))
def test_the_period_closes_without_a_jump(name, model):
    drawing = draw(resolve(GaitSettings(name=name), model), model, samples=96)
    steps = np.abs(np.diff(drawing.points, axis=0)).max(axis=(1, 2))
    closing = np.abs(drawing.points[0] - drawing.points[-1]).max()
    assert closing < 2.0 * steps.max()
    assert steps.max() < 1.0


def test_only_rolling_gaits_show_their_bellies():
    for name, gait in GAITS.items():
        backs = draw(resolve(GaitSettings(name=name), MODEL), MODEL).backs
        assert (backs.min() < -0.9) == gait.rolls, name
