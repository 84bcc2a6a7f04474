"""One function a figure; each returns a Matplotlib Figure and touches no global state."""

from wheelhop.plots.estimate import plot_estimate, plot_log
from wheelhop.plots.identification_fit import plot_fit_overlay, plot_fit_spectra
from wheelhop.plots.identification_quality import plot_correlation, plot_descent
from wheelhop.plots.innovations import plot_innovations
from wheelhop.plots.montecarlo import plot_campaign
from wheelhop.plots.resonances import plot_corner_spectrum
from wheelhop.plots.road import plot_road
from wheelhop.plots.surface import plot_surface
from wheelhop.plots.tire import plot_tire
from wheelhop.plots.vehicle import plot_vehicle_record

__all__ = [
    "plot_campaign",
    "plot_corner_spectrum",
    "plot_correlation",
    "plot_descent",
    "plot_estimate",
    "plot_fit_overlay",
    "plot_fit_spectra",
    "plot_innovations",
    "plot_log",
    "plot_road",
    "plot_surface",
    "plot_tire",
    "plot_vehicle_record",
]
