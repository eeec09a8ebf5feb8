"""How often the report's intervals cover the truth and its tests raise false alarms, measured on simulated studies.

`python -m app.coverage` measures intervals, comparisons and the mixed model, `python -m app.coverage.looks` planned looks at an
open study. Every interval comes from the functions of `app.statistics` that the report itself calls.
"""
