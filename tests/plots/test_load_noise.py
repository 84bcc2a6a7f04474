"""The figure of noisy loads draws truth, estimate and stated band, and says what it cuts."""

import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.plots.load_noise import NoisyLoad, plot_noisy_loads

TIME = np.linspace(0.0, 4.0, 41)
TRUE = 5000.0 + 1000.0 * (TIME > 1.0)


def noisy(sigma: float, size: float) -> NoisyLoad:
    load = TRUE + size * np.where(np.arange(41) % 2, 1.0, -1.0)
    load[-1] = np.nan
    return NoisyLoad(load, np.full(41, sigma))


def test_panels_share_the_scale_of_the_estimates():
    calm, wide = noisy(100.0, 50.0), noisy(4000.0, 400.0)
    figure = plot_noisy_loads(TIME, TRUE, {"calm": calm, "wide": wide}, (0.5, 4.0), "Noise")
    figure.draw_without_rendering()
    top, bottom = figure.axes
    assert [ax.get_title(loc="left") for ax in (top, bottom)] == ["calm", "wide"]
    assert top.get_ylim() == bottom.get_ylim()
    low, high = top.get_ylim()
    assert 4.0 < low < 4.6
    assert 6.4 < high < 7.0
    estimate, truth = bottom.lines
    np.testing.assert_allclose(truth.get_ydata(), 1e-3 * TRUE[5:])
    np.testing.assert_allclose(estimate.get_ydata(), 1e-3 * wide.load[5:])
    band = top.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == pytest.approx((4.75, 6.25))
    assert [text.get_gid() for text in top.texts] == []
    (note,) = bottom.texts
    assert "down to -3.4 and up to 14 kN" in note.get_text()


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(InputError, match="there is none"):
        plot_noisy_loads(TIME, TRUE, {}, (0.0, 4.0))
    with pytest.raises(InputError, match="another length"):
        plot_noisy_loads(TIME, TRUE, {"short": NoisyLoad(TRUE[1:], TRUE[1:])}, (0.0, 4.0))
    with pytest.raises(InputError, match="holds no samples"):
        plot_noisy_loads(TIME, TRUE, {"calm": noisy(1.0, 1.0)}, (9.0, 10.0))
