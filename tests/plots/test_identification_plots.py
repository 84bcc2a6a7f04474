"""Figures of an identification: labelled with units, and what they draw is the data."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.signal import welch

from wheelhop.identification.descent import Descended
from wheelhop.identification.identify import Identification
from wheelhop.identification.parameters import search_space
from wheelhop.identification.replay import Replay
from wheelhop.identification.summary import (
    descent_norms,
    parameter_note,
    relative_errors,
    starts_at_best,
    summarise_identification,
    unit_suffix,
)
from wheelhop.identification.uncertainty import Direction, Uncertainty
from wheelhop.plots.identification_fit import plot_fit_overlay, plot_fit_spectra, shown_records
from wheelhop.plots.identification_quality import plot_correlation, plot_descent
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.record import CornerRecord

T = 0.002 * np.arange(1, 2001)
NAMES = ("suspension.damping", "suspension.stiffness", "sprung_mass", "tire.damping")


def identification():
    """One parameter known well, one badly, one not at all and one held at its bound."""
    correlation = np.array([[1.0, 0.9, -0.2], [0.9, 1.0, 0.1], [-0.2, 0.1, 1.0]])
    held = np.full((4, 4), np.nan)
    held[:3, :3] = correlation
    history = np.array([[0.9, 1e12, 0.5], [0.2, 0.4, 0.4], [0.01, 0.1, 0.0101]])
    return Identification(
        car=brancati_suv(),
        start=brancati_suv(),
        space=search_space(NAMES),
        values=np.array([2400.0, 30e3, 400.0, 0.0]),
        uncertainty=Uncertainty(
            np.array([24.0, 15e3, np.inf, np.nan]),
            np.array([48.0, 20e3, np.inf, np.nan]),
            held,
            (Direction({NAMES[0]: 1.0, NAMES[1]: 0.0, NAMES[2]: 0.0}, 0.02),),
        ),
        at_bound=("", "", "", "lower"),
        names=("one",),
        rmse=np.array([[0.3, 0.4]]),
        start_rmse=np.array([[3.0, 4.0]]),
        measured_rms=np.array([[6.0, 8.0]]),
        loss=0.5,
        unexplained=0.01,
        descent=Descended(
            np.zeros((3, 4)),
            history[-1],
            np.array([True, False, True]),
            history,
            np.array([1.0, 2.0, 3.0]),
            np.array([3, 6, 9]),
            1,
        ),
        problems=("tire.damping is at its lower bound",),
    )


def one_replay(name="one", kpa=180.0, speed=16.0, noise=0.5):
    rng = np.random.default_rng(0)
    body, wheel = np.sin(2 * np.pi * 1.5 * T), 5 * np.sin(2 * np.pi * 10 * T)
    record = CornerRecord(
        T,
        body + noise * rng.normal(size=len(T)),
        wheel + noise * rng.normal(size=len(T)),
        np.full(len(T), speed),
        np.full(len(T), 1e3 * kpa),
        np.zeros(len(T)),
    )
    start = Accelerations(0.5 * body, 0.5 * wheel)
    return Replay(name, record, T > 1.0, start, Accelerations(body, wheel), 0 * T, 0 * T)


def replays():
    return [one_replay(f"{p} {v}", p, v / 3.6) for p in (130, 180, 230) for v in (40, 60, 80)]


def lost_start():
    one = one_replay()
    return [one._replace(start=Accelerations(*(np.full(len(T), np.nan) for _ in range(2))))]


FIGURES = {
    "overlay": lambda: plot_fit_overlay(replays()),
    "overlay of one": lambda: plot_fit_overlay([one_replay()]),
    "overlay without a start": lambda: plot_fit_overlay(lost_start()),
    "spectra": lambda: plot_fit_spectra(replays()),
    "spectra without a start": lambda: plot_fit_spectra(lost_start()),
    "descent": lambda: plot_descent(identification()),
    "correlation": lambda: plot_correlation(identification()),
}


@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_labelled_with_units(name, tmp_path):
    figure = FIGURES[name]()
    assert isinstance(figure, Figure)
    labels = [text for ax in figure.axes for text in (ax.get_xlabel(), ax.get_ylabel()) if text]
    assert len(labels) >= 2
    assert all("[" in text for text in labels)
    figure.savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_lowest_and_highest_pressure_at_the_middle_speed_are_shown():
    chosen = [replays()[k].name for k in shown_records(replays())]
    assert chosen == ["130 60", "230 60"]
    assert shown_records([one_replay()]) == (0,)
    titles = [ax.get_title() for ax in plot_fit_overlay(replays()).axes]
    assert titles[:2] == ["130 60: 130 kPa, 60 km/h", "230 60: 230 kPa, 60 km/h"]


def test_the_overlay_shows_two_seconds_of_what_was_measured_and_fitted():
    one = one_replay()
    wheel, body = plot_fit_overlay([one]).axes
    for ax, signal in ((wheel, "a_u"), (body, "a_s")):
        measured, start, fit = ax.lines[:3]
        t = measured.get_xdata()
        assert t[-1] - t[0] == pytest.approx(2.0, abs=0.01)
        assert t[0] > 1.0
        inside = np.isin(T, t)
        np.testing.assert_array_equal(measured.get_ydata(), getattr(one.record, signal)[inside])
        np.testing.assert_array_equal(start.get_ydata(), getattr(one.start, signal)[inside])
        np.testing.assert_array_equal(fit.get_ydata(), getattr(one.fit, signal)[inside])
    # half of a sine of amplitude 5, and noise of 0.5
    assert "start 1.8" in wheel.texts[0].get_text()
    assert "fit 0.5" in wheel.texts[0].get_text()


def test_missing_samples_do_not_spoil_the_figures():
    one = one_replay()
    gap = np.where((T > 2.0) & (T < 2.1), np.nan, one.record.a_u)
    broken = one._replace(record=replace(one.record, a_u=gap))
    wheel = plot_fit_overlay([broken]).axes[0]
    assert "fit 0.5" in wheel.texts[0].get_text()
    density = plot_fit_spectra([broken]).axes[0].lines[0].get_ydata()
    assert np.isfinite(density).all()


def test_the_residual_spectrum_is_that_of_the_noise():
    """White noise of 0.5 m/s^2 at 500 Hz has the one-sided density 0.5^2 / 250 Hz."""
    one = one_replay()
    residual = plot_fit_spectra([one]).axes[1].lines[1].get_ydata()
    assert np.mean(residual) == pytest.approx(0.25 / 250, rel=0.2)
    f, density = welch(one.fit.a_u[T > 1.0], fs=500.0, nperseg=1000, noverlap=750, nfft=4000)
    fit = plot_fit_spectra([one]).axes[0].lines[3]
    np.testing.assert_allclose(
        fit.get_ydata(), density[(f >= 0.5) & (f <= 40.0)], rtol=1e-9, atol=1e-20
    )


def test_descent_draws_norms_and_leaves_out_what_ran_away():
    found = identification()
    norms = descent_norms(found)
    # the measurements' norm is 10 m/s^2
    np.testing.assert_allclose(norms[:, 0], 10 * np.sqrt([0.9, 0.2, 0.01]))
    assert np.isnan(norms[0, 1])
    top, bottom = plot_descent(found).axes
    best = top.lines[-1]
    np.testing.assert_allclose(best.get_ydata(), norms[:, 0])
    np.testing.assert_array_equal(bottom.lines[-1].get_xdata(), [1.0, 2.0, 3.0])
    assert top.patches[0].get_x() + top.patches[0].get_width() == 1.0


def test_errors_are_bars_and_words_where_there_is_no_number():
    matrix, errors = plot_correlation(identification()).axes[:2]
    shown = [text.get_text() for text in matrix.texts]
    assert shown[1] == "+0.90"
    assert shown[-1] == "held"
    words = [text.get_text() for text in errors.texts]
    assert words == ["1 %", "50 %", "2 %", "67 %", "not determined", "at its lower bound"]


def test_notes_and_relative_errors():
    found = identification()
    np.testing.assert_allclose(relative_errors(found), [0.02, 2 / 3, np.inf, np.nan])
    notes = [parameter_note(found, k) for k in range(4)]
    assert notes == ["", "hardly known", "not known", "at its lower bound"]
    # the third start's loss is half a percent above the best one's
    assert starts_at_best(found) == 2


def test_the_summary_names_its_units():
    content = summarise_identification(identification())
    assert list(content["parameters"]) == [
        *("suspension.damping_Ns_per_m", "suspension.stiffness_N_per_m"),
        *("sprung_mass_kg", "tire.damping_Ns_per_m"),
    ]
    assert content["parameters"]["sprung_mass_kg"]["start"] == pytest.approx(466.669, abs=1e-3)
    assert content["start_loss_m_per_s2"] == pytest.approx(5.0)
    assert content["measured_norm_m_per_s2"] == pytest.approx(10.0)
    assert content["records"][0]["a_u_start_rmse_m_per_s2"] == 4.0
    assert content["descent"]["iterations"] == 2
    assert unit_suffix("Ns^2/m^2") == "_Ns2_per_m2"
    assert unit_suffix("1") == ""
