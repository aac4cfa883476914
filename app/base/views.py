"""Pictures and tables of objects, made by a higher layer when they are wanted.

The classes of low layers have methods such as `plot`. `app` sets `load` to a function that imports `app.api.views`,
which draws them.
"""


def load():
    """Return the module that makes the views."""
    raise ImportError("import app first")
