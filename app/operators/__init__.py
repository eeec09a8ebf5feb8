"""The operators of a server by name: their passwords as hashes, their second factor, how fast may be guessed, what they did."""
