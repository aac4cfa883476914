"""Access to the module that draws, for modules that may not import it.

Some classes have a method `plot`, but may not import `app.api.views` (see docs/architecture.md). They call `load`,
which `app` replaces by a function that imports `app.api.views`.
"""


def load():
    """Return the module that draws pictures and makes tables."""
    raise ImportError("import app first")
