"""Copies of the database: made while people play, verified, kept in rotation, put back, and read out of a damaged file."""
