"""Episodes of policies and walks that nobody trained, and what is measured on them: visits, quadrants, moves to each share."""
