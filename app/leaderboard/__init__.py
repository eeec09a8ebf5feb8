"""People, policies and rules of thumb on one scale: what stands on the page `/leaderboard`."""
