"""Which versions of Gymnasium, NumPy and Python, and which libraries, does the environment run with?"""
