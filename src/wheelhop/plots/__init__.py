"""One function a figure; each returns a Matplotlib Figure and touches no global state."""

from wheelhop.plots.estimate import plot_estimate, plot_log
from wheelhop.plots.innovations import plot_innovations
from wheelhop.plots.montecarlo import plot_campaign
from wheelhop.plots.road import plot_road

__all__ = ["plot_campaign", "plot_estimate", "plot_innovations", "plot_log", "plot_road"]
