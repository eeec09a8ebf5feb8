"""The report of a study: its numbers, its page and its file.

`build.build(data, runs)` gives the numbers, `page.render(report)` the page, `to_json()` the file. A
report is over the people or, marked SYNTHETIC, over the scripts that played; never over both. The
server needs neither SciPy nor Matplotlib: what it shows of people is in `statistics.study_figures`
and `statistics.human_level`.
"""
