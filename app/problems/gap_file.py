"""Fields of the cells from files: undeformed distance, hardness, surface compliance."""

from app.base.errors import InputError
from app.problems.arrays import check_compliance, check_hardness, check_shape, check_size
from app.problems.surfaces.array_file import StoredArray, read_array
from app.problems.surfaces.points import detect_list
from app.problems.surfaces.text_heads import read_gwyddion_head


class FieldFile(StoredArray):
    """Array from a file, one number per cell.

    Subclasses have a `label`, and the `quantity` and `unit` of the numbers.
    """

    quantity, unit = "number", ""

    def __init__(self, file):
        content = read_array(file, self.label)
        super().__init__(str(file), content.array)
        unit, _ = read_gwyddion_head(content.comments)
        if unit not in (None, self.unit):
            raise InputError(f"{self.label} {file}: says {unit}; must be {self.unit}")
        if kind := content.is_text and detect_list(self._array):
            raise InputError(
                f"{self.label} {file}: {self.shape[0]} lines of {self.shape[1]} numbers are {kind}, not a map; must be "
                f"the {self.quantity} of all cells in rows and columns, without x and y; such narrow ones as .npy"
            )

    def check_grid(self, grid):
        """Raise if a grid's shape is not the array's."""
        check_shape(f"{self.label} {self.file}", self.shape, grid)


class HardnessFile(FieldFile):
    """Hardness [N/mm2] from a file; infinite where a cell stays elastic."""

    label, quantity, unit = "hardness file", "hardness", "N/mm2"

    def values_on(self, grid):
        """Return the validated hardness of a grid's cells; None if all are elastic."""
        self.check_grid(grid)
        return check_hardness(self.rows(), grid, f"{self.label} {self.file}")


class ComplianceFile(FieldFile):
    """Surface compliance [mm3/N] from a file."""

    label, quantity, unit = "surface compliance file", "surface compliance", "mm3/N"

    def values_on(self, grid):
        """Return the validated surface compliance of a grid's cells; a number if all are equal."""
        self.check_grid(grid)
        return check_compliance(self.rows(), grid, f"{self.label} {self.file}")


class GapFile(FieldFile):
    """Undeformed distance [mm] from a file; NaN where contact is impossible."""

    label, quantity, unit = "gap file", "gap", "mm"
    name, sampled, by_rows = "file", True, True

    def check(self, rows):
        """Raise if gap values in a slice of `rows` are too large."""
        check_size(f"gap file {self.file}", self.rows(rows), rows.start or 0)

    def shape_on(self, grid, rows=slice(None)):
        """Return rows of the gap [mm]; the grid must have its shape."""
        if grid.shape != self.shape:
            raise ValueError("a sampled gap is known on its own grid only")
        return self.rows(rows)

    def describe(self):
        """Return the file's name, for the result file."""
        return {"gap_file": self.file}
