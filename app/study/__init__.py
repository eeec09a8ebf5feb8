"""A study of how well people play: its protocol and seeds, its participants and their way, what they did."""
