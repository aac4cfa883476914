"""What the program is trusted for, checked: each check is a small function that measures figures with limits.

`app.verify` makes a document of all of them; the test suite runs each on its small cases.
"""
