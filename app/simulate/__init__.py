"""Synthetic players, who play a whole study over the HTTP calls and sockets that browsers use.

They are labelled `script` for ever and enter no human figure. The true level of their population can be computed, so the
intervals of a report can be checked against it.
"""
