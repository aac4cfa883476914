"""Measured surfaces: heights in a file, in their own unit, levelled, cropped, with missing points.

A height map is read in runs of rows, and each rank keeps its own rows only; what is found in all of it (level, missing
points) every rank finds for itself, in the same order, so that it is the same on any number of ranks.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from app.errors import InputError
from app.halfspace.grid import Grid
from app.options import LARGEST
from app.problems.array_file import ArrayFile
from app.problems.points import gridded, looks_like_points

UNITS = {"m": 1e3, "mm": 1.0, "um": 1e-3, "nm": 1e-6}  # [mm]
LEVELS = {"none": (), "mean": ((0, 0),)}
LEVELS["plane"] = (*LEVELS["mean"], (1, 0), (0, 1))
LEVELS["quadratic"] = (*LEVELS["plane"], (2, 0), (1, 1), (0, 2))  # powers of x and y that are taken off
MISSING = ("hole", "fill")
MOST_CELLS = np.iinfo(np.int32).max  # that PETSc numbers
_RUN = 1 << 18  # cells that are looked at together
_TILTED = 4.0  # rise of the best plane over the patch in rms heights about it that is worth a note


def unit_named(name):
    """One of `UNITS` by what files call it; None if it is none of them. Not collective."""
    if isinstance(name, bytes):
        name = name.decode(errors="replace")
    name = str(name).strip().replace("µ", "u").replace("μ", "u")
    return name if name in UNITS else None


class HeightFile(ArrayFile):
    """Heights in a file, which may know their unit and spacing.

    Attributes
    ----------
    unit, lateral : str or None
        Of the heights, and of the spacing, if that is another one.
    spacing : pair of float or None
        dx, dy.
    """

    what, missing, preferred = "surface file", "missing points", "heights"

    def __init__(self, name):
        super().__init__(name)
        self.unit, self.spacing, self.lateral = self._said("unit"), None, None
        if "spacing" in self.attributes:
            self.lateral = self._said("spacing_unit") or self.unit
            self.spacing = tuple(np.atleast_1d(np.asarray(self.attributes["spacing"], float)))
            if len(self.spacing) != 2 or not (np.isfinite(self.spacing).all() and min(self.spacing) > 0):
                raise ValueError(
                    f"surface file {name}: spacing {self.spacing}: needed: two positive numbers dx, dy"
                )
        elif isinstance(self._rows, np.ndarray) and not isinstance(self._rows, np.memmap):
            if looks_like_points(self._rows.shape):
                try:
                    self._rows, self.spacing = gridded(self._rows)
                except ValueError as error:
                    raise ValueError(
                        f"surface file {name}: its lines of 3 numbers are no points x, y, z of a grid: {error} "
                        "(a map of 3 columns can be given as .npy)"
                    ) from None

    def _said(self, key):
        """Unit that an attribute names, or None."""
        if key not in self.attributes:
            return None
        unit = unit_named(self.attributes[key])
        if unit is None:
            raise ValueError(
                f"surface file {self.file}: {key} {self.attributes[key]!r}; allowed: {', '.join(UNITS)}"
            )
        return unit


@dataclass(frozen=True, eq=False)
class Surface:
    """A measured surface, made by `read_surface`; give it to `ContactProblem` among its ``surfaces``.

    Attributes
    ----------
    file : str
    unit : str
        Of the file's heights.
    shape : tuple of int
        ny, nx: cells, after cropping and averaging.
    spacing : tuple of float or None
        Size dx, dy of a cell [mm]; None: nobody has said.
    level, missing : str
        How it was levelled, what became of missing points.
    crop : tuple of int
        Columns i0 to i1 - 1 and rows j0 to j1 - 1 of the file.
    rms_height : float
        About the mean of the heights in the file that are not missing, before levelling [mm].
    missing_points : int
        Of the file, within the crop.
    notes : tuple of str
        What a user should look at twice.
    """

    file: str
    unit: str
    shape: tuple
    spacing: tuple | None
    level: str
    missing: str
    crop: tuple
    rms_height: float
    missing_points: int
    notes: tuple
    _source: object = field(repr=False)
    _coefficients: dict = field(repr=False)  # powers of x, y, from -1 to 1 over the crop -> [mm]
    _filled: tuple = field(repr=False)  # rows, columns of the crop, values [mm]
    _averaged: tuple = (1, 1)

    sampled = measured = True

    def grid(self, domain=None, periodic=False):
        """Grid of its cells; its patch lies about the origin, or where `domain` says [mm].

        Not collective.

        Raises
        ------
        InputError
            If the patch has no size, or another one than the file says.
        """
        ny, nx = self.shape
        if domain is None:
            if self.spacing is None:
                raise InputError(
                    f"-domain is missing: surface file {self.file} does not say its spacing; needed: x0,x1,y0,y1 [mm]"
                )
            lx, ly = nx * self.spacing[0], ny * self.spacing[1]
            domain = -lx / 2, lx / 2, -ly / 2, ly / 2
        grid = Grid.from_domain(nx, ny, domain, periodic)
        self.check_grid(grid)
        return grid

    def averaged(self, shape):
        """The same on fewer cells, the mean of whole blocks of cells each.

        Not collective.

        Raises
        ------
        InputError
            If the blocks are not whole.
        """
        if shape == self.shape:
            return self
        ny, nx = self.shape
        if ny % shape[0] or nx % shape[1]:
            raise InputError(
                f"grid {shape[1]},{shape[0]}: surface file {self.file} has {nx} x {ny} cells; allowed: -grid {nx},{ny} "
                "and whole fractions of both numbers, whose cells are averaged"
            )
        fy, fx = ny // shape[0], nx // shape[1]
        spacing = self.spacing and (fx * self.spacing[0], fy * self.spacing[1])
        before = self._averaged
        note = f"surface file {self.file}: {fx} x {fy} cells averaged to one: slopes and peaks are lower"
        return replace(
            self,
            shape=tuple(shape),
            spacing=spacing,
            notes=(*self.notes, note),
            _averaged=(before[0] * fy, before[1] * fx),
        )

    def check_grid(self, grid):
        """Refuse a grid whose cells are not the surface's. Not collective."""
        if grid.shape != self.shape:
            raise InputError(
                f"surface file {self.file}: has {self.shape[1]} x {self.shape[0]} cells, the grid {grid.nx} x {grid.ny}"
            )
        if self.spacing and not np.allclose((grid.dx, grid.dy), self.spacing, rtol=1e-6, atol=0):
            raise InputError(
                f"surface file {self.file}: says that its patch is {grid.nx * self.spacing[0]:.7g} x "
                f"{grid.ny * self.spacing[1]:.7g} mm; "
                f"the domain is {grid.nx * grid.dx:.7g} x {grid.ny * grid.dy:.7g} mm"
            )

    def heights(self, rows=slice(None)):
        """Heights of some rows, peaks positive, shape (rows, nx) [mm]; NaN: missing. Not collective."""
        start, stop, _ = rows.indices(self.shape[0])
        fy, fx = self._averaged
        fine = self._levelled(fy * start, fy * max(start, stop))
        if fy == fx == 1:
            return fine
        blocks = fine.reshape(-1, fy, self.shape[1], fx)
        known = ~np.isnan(blocks)
        with np.errstate(invalid="ignore"):
            return np.where(known, blocks, 0.0).sum(axis=(1, 3)) / known.sum(axis=(1, 3))

    def heights_on(self, grid, rows=slice(None)):
        """See `heights`; only on the surface's own cells."""
        if grid.shape != self.shape:
            raise ValueError("a measured surface is known on its own grid only")
        return self.heights(rows)

    def describe(self):
        """Data for the result file, by the names of the options. Not collective."""
        return {
            "surface_file": self.file,
            "surface_unit": self.unit,
            "surface_level": self.level,
            "surface_missing": self.missing,
            "surface_crop": list(self.crop),
        }

    def _levelled(self, start, stop):
        """Rows of the crop, before averaging [mm]."""
        values = _cropped(self._source, self.crop, start, stop)
        values *= UNITS[self.unit]
        j, i, heights = self._filled
        here = slice(*np.searchsorted(j, (start, stop)))
        values[j[here] - start, i[here]] = heights[here]
        x, y = _centred(self.crop[1] - self.crop[0]), _centred(self.crop[3] - self.crop[2])[start:stop]
        for (k, m), coefficient in self._coefficients.items():
            values -= coefficient * x**k * y[:, None] ** m
        return values


def read_surface(path, unit=None, level="none", crop=None, missing="hole"):
    """Read measured heights.

    Not collective: every rank looks at the whole file, a run of rows after the other.

    Parameters
    ----------
    path : str or Path
        ``.npy``, ``.h5`` (``:/dataset``), text with a row of cells a line, or text with points x, y, z of a regular
        grid in any order, in one unit. Peaks towards the other body are positive; the first row is the one of smallest
        y. What instruments write ``python -m app.convert`` turns into ``.h5``.
    unit : str, optional
        m, mm, um or nm: of the file; needed where it does not say.
    level : str
        What is taken off: none, mean, plane or quadratic (least squares on the points that are there).
    crop : sequence of int, optional
        i0, i1, j0, j1: columns i0 to i1 - 1 and rows j0 to j1 - 1 only.
    missing : str
        What becomes of missing points (NaN): "hole", contact is impossible there, or "fill" by a harmonic function.

    Returns
    -------
    Surface

    Raises
    ------
    InputError
        If it cannot be read, its unit is not known or not what the file says, or the crop lies outside.

    Examples
    --------
    >>> import tempfile
    >>> path = tempfile.mkdtemp() + "/tilted.npy"
    >>> np.save(path, np.cos(np.arange(60.0)) + 3 * np.arange(40.0)[:, None])
    >>> surface = read_surface(path, unit="um", level="plane")
    >>> surface.shape, bool(np.abs(surface.heights()).max() < 2e-3)
    ((40, 60), True)
    >>> surface.grid(domain=(0, 0.6, 0, 0.4)).dx
    0.01
    """
    for name, value, allowed in (
        ("level", level, LEVELS),
        ("missing", missing, MISSING),
        ("unit", unit, UNITS),
    ):
        if value not in allowed and not (name == "unit" and value is None):
            raise InputError(f"surface {name} {value}: not allowed; allowed: {', '.join(allowed)}")
    try:
        source = HeightFile(path)
    except (ValueError, OSError) as error:
        raise InputError(str(error)) from None
    if source.shape[0] * source.shape[1] > MOST_CELLS:
        raise InputError(
            f"surface file {path}: has {source.shape[1]} x {source.shape[0]} cells; allowed: {MOST_CELLS}"
        )
    unit = _agreed_unit(source, unit)
    crop = _checked_crop(source, crop)
    scale = UNITS[unit]
    moments = _Moments.of(source, crop, scale)
    ny, nx = crop[3] - crop[2], crop[1] - crop[0]
    holes = nx * ny - int(moments.count)
    notes, filled = [], (np.zeros(0, int), np.zeros(0, int), np.zeros(0))
    if holes and missing == "fill":
        values = _cropped(source, crop, 0, ny)
        values *= scale
        from app.problems.fill import harmonic_fill  # sparse solvers take a while to load

        filled = harmonic_fill(values)
    elif holes:
        notes.append(
            f"surface file {source.file}: {holes} of {nx * ny} points are missing: cells without any cannot touch; "
            "fill them by -surface_missing fill"
        )
    rise, rms = moments.tilt()
    if level in ("none", "mean") and rise > _TILTED * rms > 0:
        notes.append(
            f"surface file {source.file}: is tilted by {rise:.3g} mm over the patch, its rms height about the best "
            f"plane is {rms:.3g} mm; level it by -surface_level plane if that is the instrument's"
        )
    lateral = source.spacing and UNITS[source.lateral or unit]
    return Surface(
        file=source.file,
        unit=unit,
        shape=(ny, nx),
        spacing=source.spacing and tuple(lateral * side for side in source.spacing),
        level=level,
        missing=missing,
        crop=crop,
        rms_height=moments.rms,
        missing_points=holes,
        notes=tuple(notes),
        _source=source,
        _coefficients=moments.fit(LEVELS[level]),
        _filled=filled,
    )


def _agreed_unit(source, unit):
    if source.unit is None and unit is None:
        raise InputError(
            f"-surface_unit is missing: surface file {source.file} does not say the unit of its heights; "
            f"allowed: {', '.join(UNITS)}"
        )
    if source.unit and unit and unit != source.unit:
        raise InputError(f"-surface_unit {unit}: surface file {source.file} says {source.unit}")
    return source.unit or unit


def _checked_crop(source, crop):
    ny, nx = source.shape
    if crop is None:
        return 0, nx, 0, ny
    i0, i1, j0, j1 = crop = tuple(int(cell) for cell in crop)
    if not (0 <= i0 < i1 <= nx and 0 <= j0 < j1 <= ny):
        raise InputError(
            f"surface crop {i0},{i1},{j0},{j1}: not allowed; surface file {source.file} has columns 0,{nx} and rows "
            f"0,{ny}: needed: i0 < i1 and j0 < j1 within them"
        )
    return crop


def _cropped(source, crop, start, stop):
    """Rows start to stop - 1 of the crop, in the file's unit."""
    i0, i1, j0, _ = crop
    return np.ascontiguousarray(source.rows(slice(j0 + start, j0 + stop))[:, i0:i1])


def _centred(n):
    """Cell centres of n cells between -1 and 1."""
    return (2 * np.arange(n) + 1) / n - 1


class _Moments:
    """Sums over the heights z that are there: of x^k y^m, and of z x^k y^m; x and y go from -1 to 1 [mm]."""

    def __init__(self):
        self.powers, self.products, self.squares = np.zeros((5, 5)), np.zeros((3, 3)), 0.0
        self.reference = None

    @classmethod
    def of(cls, source, crop, scale):
        """Look at all of a file once, a run of rows after the other."""
        moments = cls()
        ny, nx = crop[3] - crop[2], crop[1] - crop[0]
        x, y, step = _centred(nx), _centred(ny), max(1, _RUN // nx)
        for start in range(0, ny, step):
            rows = slice(start, min(start + step, ny))
            moments._add(
                source, scale * _cropped(source, crop, rows.start, rows.stop), x, y[rows], rows.start
            )
        if not moments.count:
            raise InputError(f"surface file {source.file}: all points are missing (NaN)")
        return moments

    def _add(self, source, z, x, y, first):
        there = ~np.isnan(z)
        if not there.any():
            return
        large = np.argwhere(there & ~(np.abs(z) < LARGEST))
        if len(large):
            j, i = large[0]
            raise InputError(
                f"surface file {source.file}: {z[j, i]:g} mm in row {first + j}, column {i}; allowed: numbers, and NaN "
                "for missing points"
            )
        if self.reference is None:
            self.reference = z[there][0]  # so that large offsets cost no digits
        z = np.where(there, z - self.reference, 0.0)
        in_x, in_y = (np.stack([values**k for k in range(5)]) for values in (x, y))
        self.powers += in_x @ there.T.astype(float) @ in_y.T
        self.products += in_x[:3] @ z.T @ in_y[:3].T
        self.squares += float(np.einsum("ji,ji", z, z))

    @property
    def count(self):
        """Points that are there."""
        return self.powers[0, 0]

    @property
    def rms(self):
        """Standard deviation of the heights [mm]."""
        return float(np.sqrt(max(self._left_by(LEVELS["mean"]), 0.0)))

    def tilt(self):
        """Rise of the best plane from side to side, and the standard deviation about it [mm]."""
        plane = self._solve(LEVELS["plane"])
        left = max(self._left_by(LEVELS["plane"]), 0.0)
        return float(2 * (abs(plane[1]) + abs(plane[2]))), float(np.sqrt(left))

    def fit(self, terms):
        """Coefficients of the least squares polynomial of some powers: (k, m) -> [mm]."""
        coefficients = dict(zip(terms, map(float, self._solve(terms)), strict=True))
        if terms:
            coefficients[0, 0] += self.reference
        return coefficients

    def _solve(self, terms):
        if not terms:
            return np.zeros(0)
        gram = np.array([[self.powers[k + p, m + q] for p, q in terms] for k, m in terms])
        right = np.array([self.products[k, m] for k, m in terms])
        return np.linalg.lstsq(gram, right, rcond=1e-12)[0]  # of one row of points no slope across is known

    def _left_by(self, terms):
        """Mean square about the polynomial."""
        right = np.array([self.products[k, m] for k, m in terms])
        return (self.squares - right @ self._solve(terms)) / self.count
