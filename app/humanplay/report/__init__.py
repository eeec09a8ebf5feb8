"""The report of a study: `build.build(data, runs)` gives its numbers, `page.render(report)` the
page, `to_json()` the file.

It is over the people or, marked SYNTHETIC, over the scripts that played; never over both. The
server needs neither SciPy nor Matplotlib: what it shows of people is in `statistics.study_figures`
and `statistics.human_level`.
"""
