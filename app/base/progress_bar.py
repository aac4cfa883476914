"""Progress bars of load paths and refinements."""

import warnings


def progress_bar(rank, **arguments):
    """Return a progress bar (tqdm), which only rank 0 shows."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # without ipywidgets notebooks show the bar as text
        from tqdm.auto import tqdm  # loads slowly
    return tqdm(disable=rank > 0, **arguments)
