"""Do policies that other libraries export play here as they play there?"""
