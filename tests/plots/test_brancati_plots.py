"""Figures of errors over many runs, pressure courses and tuning: what they draw is the data."""

import warnings

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from wheelhop.errors import InputError
from wheelhop.estimators.tuning import Tuned, TuningSettings
from wheelhop.evaluation.courses import Course
from wheelhop.evaluation.errors import ErrorStatistics
from wheelhop.evaluation.tracking import Interval, Tracking
from wheelhop.plots.error_bounds import ErrorPanel, plot_error_bounds
from wheelhop.plots.panels import filter_colours
from wheelhop.plots.pressure_cases import plot_cases
from wheelhop.plots.pressure_courses import plot_modes, plot_tracking
from wheelhop.plots.style import ALERT, CLASS_COLOURS, ESTIMATE, TRUTH
from wheelhop.plots.tuning import plot_tuning

T = 0.1 * np.arange(1, 101)
TRUTH_PA = np.interp(T, [5.0, 6.5], [230e3, 180e3])
ABSURD = (np.nan, np.inf, -1e300)


def error_panel(mean=5e3, std=20e3, sigma=10e3, sample=-12e3):
    """Constant curves [N/m] by which each line of a panel is recognised."""
    full = np.full_like(T, 1.0)
    return ErrorPanel(
        Tracking(
            ErrorStatistics(mean * full, std * full, sigma * full, std * full),
            inside=0.42,
            inside_by_run=0.1,
            nees=full,
            nees_band=(0.7, 1.3),
            final_rmse=Interval(31.4e3, 26.6e3, 36.2e3),
            final_bias=0.0,
            converged=0.5,
            convergence_time=1.0,
        ),
        sample * full,
    )


def course(pressure=200e3, modes=("A", "B", "C", "D"), mode_pressure=None, sigma=8e3):
    """A course that holds still; its modes lie 10 kPa apart unless told."""
    full = np.ones_like(T)
    each = pressure - 10e3 * np.arange(len(modes)) if mode_pressure is None else mode_pressure
    return Course(
        T,
        pressure * full,
        sigma * full,
        np.asarray(each) * np.ones((len(T), len(modes))),
        np.full((len(T), len(modes)), 1.0 / len(modes)),
        modes,
        (pressure - 12e3) * full,
        (pressure + 12e3) * full,
    )


def tuned(objective="mse", history=(900.0, np.nan, 400.0, 300.0), factor=10.0, **options):
    start = {"q_1": 2.0, "p0_pressure": 10e3}
    tuning = {"q_1": 2.0 * factor, "p0_pressure": 10e3}
    values = {"train": 300.0, "test": 350.0, "start_test": 950.0} | options
    settings = TuningSettings(objective=objective, held=("p0_pressure",))
    return Tuned(tuning, start, np.array(history), settings=settings, **values)


def drawn(figure):
    """Draw it with every warning an error, and require limits that are finite and not empty."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        FigureCanvasAgg(figure).draw()
    for ax in figure.axes:
        limits = np.array([ax.get_xlim(), ax.get_ylim()])
        assert np.isfinite(limits).all()
        assert (limits[:, 0] != limits[:, 1]).all()
    return figure


def notes(ax):
    return [text.get_text() for text in ax.texts if text.get_gid() == "cut"]


def line(ax, colour, style="-"):
    """Values of the first line of a colour and style that has any."""
    lines = [
        np.asarray(found.get_ydata())
        for found in ax.lines
        if found.get_color() == colour and found.get_linestyle() == style
    ]
    return next(values for values in lines if values.size)


def test_error_bounds_draw_the_four_curves_of_the_paper_in_its_colours():
    panels = {"as printed": error_panel(), "corrected": error_panel(mean=-3e3)}
    figure = drawn(plot_error_bounds(T, panels, "Fig. 6", prior=26e3, slope=1.1))
    first, second = figure.axes
    np.testing.assert_allclose(line(first, ALERT), 5.0)
    np.testing.assert_allclose(line(second, ALERT), -3.0)
    np.testing.assert_allclose(line(first, CLASS_COLOURS["A"]), -12.0)
    blue = [x.get_ydata()[0] for x in first.lines if x.get_color() == ESTIMATE]
    black = [x.get_ydata()[0] for x in first.lines if x.get_color() == TRUTH and x.get_ls() == "--"]
    np.testing.assert_allclose(sorted(blue), [5.0 - 20.0, 5.0 + 20.0])
    np.testing.assert_allclose(sorted(black), [-10.0, 10.0])
    title = first.get_title(loc="left")
    assert "as printed" in title
    assert "42 %" in title
    assert "31 kPa (95 %: 27 to 36)" in title
    assert "[kN/m]" in first.get_ylabel()
    assert first.get_xlabel() == second.get_xlabel() == "time [s]"
    assert first.get_ylim() == second.get_ylim()
    assert not notes(first) + notes(second)


def test_error_bounds_cut_a_wild_filter_off_and_say_so():
    panels = {"good": error_panel(), "fair": error_panel(), "wild": error_panel(std=3e6)}
    figure = drawn(plot_error_bounds(T, panels, prior=26e3))
    assert figure.axes[0].get_ylim()[1] < 150.0
    assert [len(notes(ax)) for ax in figure.axes[:3]] == [0, 0, 1]
    assert notes(figure.axes[2])[0] == (
        "cut off: standard deviation\n(down to -2995 and up to 3005 kN/m)"
    )
    # the fourth place is empty, so the panel above it names the time
    assert not figure.axes[3].get_visible()
    assert figure.axes[1].get_xlabel() == "time [s]"


def test_error_bounds_keep_everything_in_view_where_filters_are_alike():
    panels = {"a": error_panel(std=90e3), "b": error_panel(std=100e3)}
    figure = drawn(plot_error_bounds(T, panels))
    assert figure.axes[0].get_ylim()[1] > 105.0
    assert not any(notes(ax) for ax in figure.axes)


@pytest.mark.parametrize("bad", ABSURD)
def test_error_bounds_survive_absurd_numbers(bad):
    panels = {"bad": error_panel(bad, bad, bad, bad), "good": error_panel()}
    figure = drawn(plot_error_bounds(T, panels))
    assert notes(figure.axes[0])
    assert not notes(figure.axes[1])


def test_modes_show_estimate_modes_and_probabilities_of_each_filter():
    courses = {"as printed": course(150e3), "class A alone": course(210e3, ("A",))}
    figure = drawn(plot_modes(T, TRUTH_PA, courses, (5.0, "A to D"), "Fig. 9"))
    axes = np.array(figure.axes).reshape(3, 2)
    assert [ax.get_title(loc="left") for ax in axes[0]] == ["as printed", "class A alone"]
    np.testing.assert_allclose(line(axes[0, 0], ESTIMATE), 150.0)
    np.testing.assert_allclose(line(axes[0, 1], TRUTH, "--"), TRUTH_PA / 1e3)
    for k, mode in enumerate("ABCD"):
        np.testing.assert_allclose(line(axes[1, 0], CLASS_COLOURS[mode]), 150.0 - 10.0 * k)
    assert len(axes[2, 0].collections) == 4
    assert len(axes[2, 1].collections) == 1
    assert [text.get_text() for text in axes[0, 0].texts] == ["A to D"]
    for ax in axes.flat:
        assert any(np.all(np.asarray(x.get_xdata()) == 5.0) for x in ax.lines)
    assert all("[kPa]" in ax.get_ylabel() for ax in axes[:2, 0])
    assert "[-]" in axes[2, 0].get_ylabel()
    assert [ax.get_xlabel() for ax in axes[2]] == ["time [s]"] * 2
    assert not any(notes(ax) for ax in axes.flat)


def test_modes_cut_implausible_pressures_off_and_name_the_modes():
    wild = course(mode_pressure=[200e3, 190e3, -700e3, 900e3])
    figure = drawn(plot_modes(T, TRUTH_PA, {"as printed": wild, "corrected": course()}))
    axes = np.array(figure.axes).reshape(3, 2)
    low, high = axes[1, 0].get_ylim()
    assert -50.0 < low <= 0.0
    assert 400.0 <= high < 450.0
    assert notes(axes[1, 0]) == ["cut off: class C; class D\n(down to -700 and up to 900 kPa)"]
    assert not notes(axes[0, 0]) + notes(axes[1, 1])


@pytest.mark.parametrize("bad", ABSURD)
def test_courses_survive_absurd_numbers(bad):
    broken = course(bad, sigma=abs(bad))._replace(probabilities=np.full((len(T), 4), bad))
    courses = {"bad": broken, "good": course()}
    tops = (
        plot_modes(T, TRUTH_PA, courses).axes[0],
        plot_tracking(T, TRUTH_PA, courses).axes[0],
        plot_cases(T, {"light": (TRUTH_PA, courses)}).axes[0],
    )
    for ax in tops:
        assert notes(ax)
        drawn(ax.figure)
        low, high = ax.get_ylim()
        assert -50.0 < low < 180.0
        assert 230.0 < high < 450.0


def test_tracking_overlays_pressures_and_errors():
    courses = {"as printed": course(150e3), "corrected": course(200e3)}
    figure = drawn(plot_tracking(T, TRUTH_PA, courses, event=(5.0, "loss begins")))
    top, bottom = figure.axes
    for name, colour in filter_colours(courses).items():
        pressure = courses[name].pressure
        np.testing.assert_allclose(line(top, colour), pressure / 1e3)
        np.testing.assert_allclose(line(bottom, colour), (pressure - TRUTH_PA) / 1e3)
    late = 1e-3 * (150e3 - TRUTH_PA)[T > 2.0]
    expected = f"as printed: {np.sqrt(np.mean(late**2)):.0f} kPa rms after 2 s"
    assert expected in [text.get_text() for text in figure.legends[0].get_texts()]
    assert "[kPa]" in top.get_ylabel()
    assert "[kPa]" in bottom.get_ylabel()
    assert bottom.get_xlabel() == "time [s]"
    assert not notes(top) + notes(bottom)
    (only,) = drawn(plot_tracking(T, TRUTH_PA, courses, ("error",))).axes
    assert only.get_ylabel() == bottom.get_ylabel()


def test_tracking_says_which_filter_leaves_the_panel():
    courses = {"as printed": course(-300e3), "corrected": course(200e3)}
    top, bottom = drawn(plot_tracking(T, TRUTH_PA, courses)).axes
    assert notes(top) == ["cut off: as printed\n(down to -300 kPa)"]
    assert notes(bottom) == ["cut off: as printed\n(down to -530 kPa)"]


def test_cases_give_the_mean_error_of_every_case_in_percent():
    truth = np.full_like(T, 200e3)
    cases = {
        "1788 kg": (truth, {"as printed": course(180e3), "corrected": course(204e3)}),
        "2218 kg": (truth, {"as printed": course(150e3), "corrected": course(190e3)}),
    }
    figure = drawn(plot_cases(T, cases, "Fig. 11"))
    axes = np.array(figure.axes).reshape(2, 2)
    assert [ax.get_title(loc="left") for ax in axes[0]] == ["as printed", "corrected"]
    shares = [[text.get_text() for text in ax.texts] for ax in axes[1]]
    assert shares == [["-10 %", "-25 %"], ["+2 %", "-5 %"]]
    colours = [text.get_color() for text in axes[1, 0].texts]
    np.testing.assert_allclose(line(axes[0, 0], colours[1]), 150.0)
    np.testing.assert_allclose(line(axes[1, 1], colours[1]), -10.0)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[:3] == ["true", "1788 kg", "2218 kg"]


def test_cases_with_their_own_truths_draw_each():
    both = {"corrected": course()}
    cases = {"low": (np.full_like(T, 130e3), both), "high": (np.full_like(T, 230e3), both)}
    figure = drawn(plot_cases(T, cases))
    dashed = [x.get_ydata()[0] for x in figure.axes[0].lines if x.get_linestyle() == "--"]
    assert dashed == [130.0, 230.0]


def test_tuning_shows_training_test_values_and_knobs():
    histories = {"as printed": tuned(), "corrected": tuned(factor=0.01)}
    figure = drawn(plot_tuning(histories, "Tuning", floors={"mse": 700.0}))
    left, right = figure.axes
    colour = filter_colours(histories)["as printed"]
    assert left.get_yscale() == "log"
    np.testing.assert_allclose(line(left, colour), [900.0, np.nan, 400.0, 300.0])
    marks = [tuple(np.ravel(x.get_data())) for x in left.lines if x.get_marker() == "D"]
    assert marks[:2] == [(0.0, 950.0), (3.0, 350.0)]
    assert "[(kN/m)²]" in left.get_ylabel()
    assert left.get_xlabel() == "iteration"
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "as printed (steps taken back: 1)" in texts
    assert "constant prior" in texts
    assert [text.get_text() for text in right.get_yticklabels()] == ["q_1", "p0_pressure"]
    dots = [x for x in right.lines if x.get_marker() == "o"]
    np.testing.assert_allclose([x.get_xdata()[0] for x in dots], [1, 0, -2, 0], atol=1e-12)
    # a knob that was held is hollow
    assert [x.get_markerfacecolor() == "white" for x in dots] == [False, True, False, True]


def test_tuning_gives_each_objective_its_panel_and_scale():
    score = tuned("log_score", (4.0, 1.0, -1.5), train=-1.5, test=-1.4, start_test=4.1)
    figure = drawn(plot_tuning({"as printed": tuned(), "corrected": score}))
    first, second, _ = figure.axes
    assert (first.get_yscale(), second.get_yscale()) == ("log", "linear")
    assert second.get_ylim()[0] < -1.5
    assert "nats" in second.get_ylabel()


def test_tuning_cuts_an_excursion_off_and_survives_absurd_numbers():
    spike = tuple([900.0] * 30 + [1e9] + [300.0] * 30)
    left = drawn(plot_tuning({"a": tuned(history=spike)})).axes[0]
    assert left.get_ylim()[1] < 1e5
    assert notes(left) == ["cut off\n(up to 1e+09 (kN/m)²)"]
    for bad in ABSURD:
        history = (bad, 1.0, bad)
        absurd = tuned(history=history, factor=bad, test=bad, start_test=bad)
        drawn(plot_tuning({"bad": absurd, "good": tuned()}))
    drawn(plot_tuning({"nothing": tuned(history=(np.nan,), test=np.nan, start_test=np.nan)}))


def test_filters_of_a_family_share_a_hue():
    names = ("as printed", "as printed, class A alone", "corrected", "corrected, class A alone")
    colours = filter_colours(names)
    assert len(set(colours.values())) == 4
    assert colours["as printed"] == ALERT
    assert colours["corrected"] == ESTIMATE
    # another filter leaves the colours of those before it alone
    assert filter_colours((*names, "recursive")) == colours | {"recursive": CLASS_COLOURS["A"]}


@pytest.mark.parametrize(
    ("draw", "field"),
    [
        (lambda: plot_error_bounds(T, {}), "panels"),
        (lambda: plot_modes(T, TRUTH_PA, {}), "courses"),
        (lambda: plot_tracking(T, TRUTH_PA, {}), "courses"),
        (lambda: plot_tracking(T, TRUTH_PA, {"a": course()}, ("pressure", "sigma")), "rows"),
        (lambda: plot_cases(T, {}), "cases"),
        (
            lambda: plot_cases(
                T, {"x": (TRUTH_PA, {"a": course()}), "y": (TRUTH_PA, {"b": course()})}
            ),
            "cases",
        ),
        (lambda: plot_tuning({}), "histories"),
    ],
)
def test_input_that_cannot_be_drawn_is_refused_by_name(draw, field):
    with pytest.raises(InputError) as caught:
        draw()
    assert caught.value.field == field
