"""The experiment on what the three errors cover runs, and at its size in the documentation says what is said there."""

import numpy as np
import pytest

from experiments import error_coverage


def test_it_counts_and_draws():
    few = error_coverage.SITUATIONS[1]._replace(scattered=True)
    found = {"few": error_coverage.coverage(few, 2)}
    assert found["few"].shape == (2, 3, 4)
    assert len(error_coverage.rows(found)) == 6
    error_coverage.draw(found).draw_without_rendering()


@pytest.mark.slow  # a minute a situation
@pytest.mark.parametrize("situation", error_coverage.SITUATIONS, ids=lambda situation: situation.name)
def test_the_pseudo_true_parameters_are_covered_whatever_the_misfit_and_the_colour(situation):
    pseudo, physical = error_coverage.coverage(situation, 150)
    white, coloured, whole = pseudo
    assert np.all((coloured > 0.90) & (coloured < 0.99))  # 0.95 within three standard deviations of chance
    assert np.all(whole >= coloured)
    if situation.correlation:
        assert white.min() < 0.86
    if situation.name == "smooth":
        assert np.all((physical[2] > 0.90) & (physical[2] < 0.99))
        assert np.all(physical[1] < 0.7)
