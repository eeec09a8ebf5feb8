"""With which versions of Gymnasium, NumPy, Python and libraries does all run?"""
