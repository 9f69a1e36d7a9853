"""The compiled median against numpy's."""

import numpy as np
import pytest

from snakeslam.geometry.median import median


@pytest.mark.parametrize("count", [1, 2, 7, 10])
def test_as_numpy_has_it_and_the_numbers_stay_as_they_are(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    before = values.copy()
    assert median(values) == np.median(values)
    assert np.array_equal(values, before)
