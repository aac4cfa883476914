"""Table of the solutions of many problems."""

from numbers import Real
from typing import Any

import numpy as np

from app.base import views
from app.base.quantities import QUANTITIES, unit_of
from app.base.types import DataFrame, PathLike
from app.io.frames import to_dataframe

_SHOWN = "problem", "load", "approach", "max_pressure", "contact_area", "converged"
_MAX_ROWS = 12  # that are printed


class SolutionTable:
    """Numbers of many solutions, one row for each problem and load.

    ``table["load"]`` is the column of loads. If a row is not ``converged``, it has a ``message``. If there is no
    solution, the numbers of the row are NaN.

    Attributes
    ----------
    rows : list of dict
    """

    def __init__(self, rows: list[dict[str, Any]]) -> None:
        self.rows = rows

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def table(self) -> dict[str, np.ndarray]:
        """Columns: name -> ndarray of shape (rows,).

        Missing numbers are NaN, missing texts are empty.
        """
        names = dict.fromkeys(name for row in self.rows for name in row)
        return {name: self[name] for name in names}

    def __getitem__(self, name: str) -> np.ndarray:
        values = [row.get(name) for row in self.rows]
        known = [value for value in values if value is not None]
        if not known:
            raise KeyError(name)
        missing = np.nan if isinstance(known[0], Real) else ""
        return np.array([missing if value is None else value for value in values])

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns that are quantities, by name."""
        return {name: unit_of(name) for name in self.table if name.removeprefix("analytic_") in QUANTITIES}

    @property
    def converged(self) -> bool:
        """True if all rows converged."""
        return all(row["converged"] for row in self.rows)

    def to_dataframe(self) -> DataFrame:
        """Return a pandas.DataFrame with units in ``attrs["units"]``."""
        return to_dataframe(self.table)

    def save(self, path: PathLike) -> None:
        """Write the table as ``.csv``, ``.h5``, ``.mat``, ``.md`` or ``.txt``.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        from app.io.table import write_table

        write_table(path, self.rows)

    def __repr__(self):
        from app.io.table import format_text

        failed = sum(not row["converged"] for row in self.rows)
        more = f"\n... {len(self) - _MAX_ROWS} more" if len(self) > _MAX_ROWS else ""
        text = format_text(self.rows[:_MAX_ROWS], _SHOWN).rstrip()
        return f"{len(self)} rows, {failed} not converged; N, mm, N/mm2, mm2\n{text}{more}"

    def _repr_html_(self):
        return views.load().many_html(self)
