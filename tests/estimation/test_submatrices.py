"""Picking parts of a matrix against numpy's own."""

import numpy as np

from snakeslam.estimation.filter.submatrices import add_to_submatrix, submatrix

MATRIX = np.random.default_rng(0).normal(size=(7, 7))
ROWS, COLUMNS = np.array([5, 0, 2]), np.array([1, 6])


def test_a_part_is_as_numpy_picks_it() -> None:
    assert np.array_equal(submatrix(MATRIX, ROWS, COLUMNS), MATRIX[np.ix_(ROWS, COLUMNS)])
    assert submatrix(MATRIX, ROWS[:0], COLUMNS).shape == (0, 2)


def test_what_is_added_to_a_part_leaves_the_rest() -> None:
    matrix, added = MATRIX.copy(), np.arange(9.0).reshape(3, 3)
    add_to_submatrix(matrix, ROWS, added)
    expected = MATRIX.copy()
    expected[np.ix_(ROWS, ROWS)] += added
    assert np.array_equal(matrix, expected)
