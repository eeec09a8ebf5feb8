"""All request handlers, one module for each capability: pages, the API, sockets, studies, leaderboard, operator, 3-D view.

Handlers take what they need from `access.services_of`; `middleware` and `errors` surround every answer, and `listening`
serves the app on a socket.
"""
