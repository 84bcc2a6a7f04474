"""The figure of bounds shows every case with what it reaches."""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.text import Text

from wheelhop.errors import InputError
from wheelhop.evaluation.bound_cases import BoundCase
from wheelhop.plots.bound import plot_bound

TIME = np.geomspace(0.5, 10.0, 20)


def case(key, level, difference=False):
    return BoundCase(key, f"case {key}", difference, level / np.sqrt(TIME))


def drawn(figure):
    figure.draw_without_rendering()
    return [[text.get_text() for text in ax.texts] for ax in figure.axes]


def test_every_case_is_labelled_with_its_end():
    cases = [case("known", 0.03), case("unknown", 0.16), case("pair_1_difference", 0.008, True)]
    figure = plot_bound(TIME, cases, 287e3, "Bounds")
    left, right = drawn(figure)
    assert left == ["case known: 2.7 kPa, 0.95 %", "case unknown: 15 kPa, 5.1 %"]
    assert right == ["case pair_1_difference: 0.73 kPa, 0.25 %"]
    assert figure.axes[0].get_xscale() == figure.axes[0].get_yscale() == "log"
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), 287 * cases[0].relative)


def test_labels_of_equal_bounds_do_not_lie_on_each_other():
    figure = plot_bound(TIME, [case("a", 0.1), case("b", 0.1), case("c", 0.101)], 287e3)
    figure.draw_without_rendering()
    boxes = [Text.get_window_extent(text) for text in figure.axes[0].texts]
    edges = sorted((box.y0, box.y1) for box in boxes)
    assert all(below[1] <= above[0] for below, above in pairwise(edges))


def test_what_is_not_determined_is_said():
    never = BoundCase("more", "all unknown", False, np.full(len(TIME), np.inf))
    assert (
        "all unknown: not seen" in drawn(plot_bound(TIME, [never, case("known", 0.03)], 287e3))[0]
    )
    with pytest.raises(InputError, match="no finite bound"):
        plot_bound(TIME, [never], 287e3)
