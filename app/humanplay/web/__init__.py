"""All request handlers, one module for each capability.

Handlers take what they need from `access.services_of`; `middleware` and `errors` surround every
answer, and `listening` serves the app on a socket.
"""
