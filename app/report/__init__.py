"""The report of a study: `build(data, runs)` gives its numbers, `page.render(report)` the page, `report.to_json()` the file.

It is over the people or, marked SYNTHETIC, over the scripts that played; never over both.
"""

from app.report.build import build
from app.report.model import Report

__all__ = ["Report", "build"]
