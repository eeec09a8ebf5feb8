"""A study's report: `build(data, runs) -> Report`, `page.render(report) -> str`."""

from app.report.build import build
from app.report.model import Report

__all__ = ["Report", "build"]
