"""Option ``-lcp_released`` of the default method, in place of the constant MAX_RELEASED_SHARE."""

_ROW = """\
    released: float = _option(from_zero, 0.01,
        "fast: share of the load that a coarse grid may release at last without updating u", ("fast",), True)
"""
CHANGES = {
    "app/options/method.py": {"    texts: dict = field": f"{_ROW}    texts: dict = field"},
    "app/methods/free/iteration.py": {
        "tension > MAX_RELEASED_SHARE": "tension > self.stop.settings.released"
    },
}
