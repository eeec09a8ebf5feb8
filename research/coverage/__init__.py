"""How often the report's intervals cover the truth, and tests raise false alarms.

`python -m research.coverage` measures intervals and comparisons on simulated studies. Every
interval comes from the functions of `humanplay.report.statistics` that the report itself calls.
"""
