"""What the commands `humanplay` and `marsexplorer` share."""
