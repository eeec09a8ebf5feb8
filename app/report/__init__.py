"""A study's report: `build(data, runs) -> Report`, `page.render(report) -> str`; `live_figure(data)` is the score so far."""

from app.report.build import build, live_figure
from app.report.model import Report

__all__ = ["Report", "build", "live_figure"]
