"""Checking, publishing, joining and forgetting what was recorded."""
