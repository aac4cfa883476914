"""Checks of the program against known solutions and laws.

A check is a function that measures numbers, called figures; most of them have limits. ``python -m app.verify`` writes a
document of all checks. The test suite runs each check on small cases.
"""
