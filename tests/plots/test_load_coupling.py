"""The figure of relative gains shows every number where it belongs."""

import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.plots.load_coupling import plot_load_coupling

GAINS = np.arange(16.0).reshape(4, 4) / 20 - 0.1


def test_numbers_stand_in_their_cells():
    figure = plot_load_coupling({"ours": GAINS, "paper": GAINS.T}, "Coupling")
    figure.draw_without_rendering()
    ours, paper = figure.axes[:2]
    shown = {text.get_position(): text.get_text() for text in ours.texts}
    assert len(shown) == 16
    assert shown[1, 3] == "0.550"
    assert shown[0, 1] == "0.100"
    assert shown[0, 0] == "\N{MINUS SIGN}0.100"
    other = {text.get_position(): text.get_text() for text in paper.texts}
    assert other[3, 1] == "0.550"
    assert [t.get_text() for t in ours.get_yticklabels()] == ["FL", "FR", "RL", "RR"]
    assert ours.get_title(loc="left") == "ours"


def test_colour_is_the_distance_from_uncoupled_wheels():
    figure = plot_load_coupling({str(k): np.eye(4) for k in range(4)})
    for ax in figure.axes[:4]:
        np.testing.assert_array_equal(ax.images[0].get_array(), 0.0)
    # the second row of three is filled up with hidden panels
    assert [ax.get_visible() for ax in figure.axes[:6]] == [True] * 4 + [False] * 2


def test_other_shapes_are_refused():
    with pytest.raises(InputError, match="Give one or more"):
        plot_load_coupling({})
    with pytest.raises(InputError, match="'half'"):
        plot_load_coupling({"half": GAINS[:2]})
