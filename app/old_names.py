"""What option files of 0.1.0 say, in the words of today: nothing else of the program knows old names."""

from __future__ import annotations

from app.errors import InputError

RENAMED = {"lcp_foresight": "lcp_predictor"}
GONE = {
    "lcp_merge": "tighter contact sets (-ksp_rtol) do what it did",
    "lcp_replicate": "-lcp_cells_per_rank says how many cells a rank gets at least",
    "lcp_cheap": "a larger -lcp_rtol does what it did, with a certificate",
}
NAMES = RENAMED.keys() | GONE.keys()
_MOVED = {"multigrid.krylov": "fast.tracking_cg", "multigrid.circulant": "fast.circulant"}  # modules of app


def in_words_of_today(texts):
    """Options as they are called today. Not collective.

    Parameters
    ----------
    texts : mapping of str to str
        Of one place, such as an option file.

    Returns
    -------
    texts : dict of str to str
    warnings : list of str
        A line for every option that is renamed or gone.

    Raises
    ------
    InputError
        If an option is given by both names.

    Examples
    --------
    >>> in_words_of_today({"lcp_foresight": "1.5", "pc_python_type": "app.multigrid.circulant.Circulant"})[0]
    {'lcp_predictor': '1.5', 'pc_python_type': 'app.fast.circulant.Circulant'}
    """
    found, warnings = {}, []
    for name, text in texts.items():
        if name in GONE:
            warnings.append(f"-{name} is gone and ignored: {GONE[name]}")
            continue
        if today := RENAMED.get(name):
            if today in texts:
                raise InputError(f"-{name} is called -{today} now: only one of both is allowed")
            warnings.append(f"-{name} is called -{today} now; the old name works in this release only")
        found[today or name] = _of_today(text) if name.endswith("python_type") else text
    if found.get("ksp_python_type", "").endswith(".TrackingCG"):  # which had no -lcp_type beside it
        found.setdefault("lcp_type", "fast")
    return found, warnings


def _of_today(path):
    """Where a class is that has moved."""
    for old, new in _MOVED.items():
        path = path.replace(f"app.{old}.", f"app.{new}.")
    return path
