"""The operator's console at `/admin`: one password, one page, nobody else."""
