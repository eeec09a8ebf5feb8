"""What the daily terrain came to: people's results, those of the shipped policies, and where a player stands among them.

A player sees the results of today when their own attempt is over; those of an earlier day are everybody's.
"""
