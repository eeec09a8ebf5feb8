"""The report of a study: `build(data, runs)` gives its numbers, `page.render(report)` the page, `to_json()` the file.

It is over the people or, marked SYNTHETIC, over the scripts that played; never over both. `live_figure(data)` is the people's
score so far.
"""

from humanplay.report.build import build
from humanplay.report.model import Report
from humanplay.report.statistics.study_figures import live_figure

__all__ = ["Report", "build", "live_figure"]
