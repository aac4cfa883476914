"""Tables for Gauss-Seidel sweeps: kernels, FFT plans and storage."""

import numpy as np
from scipy.fft import rfft

from app.halfspace.fft.fftw import FFTW, aligned
from app.halfspace.fft.lengths import transform_length
from app.halfspace.gauss_seidel.kernel_in_x import KernelInX
from app.halfspace.gauss_seidel.loops import LANES, MIN_RUN, TILE, RowSolver
from app.halfspace.gauss_seidel.pipeline import deal_chunks

LEAF_ROWS = 64, 32  # On one rank, on several. More rows mean more sequential work, fewer rows more messages.
SEGMENT_COLUMNS = 512  # largest number of columns of a segment
_BATCH = 1 << 12  # complex numbers per batch of transforms in y, so that they fit in the cache


class SweepTables:
    """Kernels, FFT plans and storage of sweeps. Collective over `comm`.

    A leaf is a block of `leaf_rows` rows. A transfer adds the effect of leaves on later leaves, by transforms in y. A
    chunk is a group of `LANES` frequencies in x. Rank 0 has the tables to solve leaves. Each rank that computes
    transfers has the tables of transfers for its chunks.

    In ``(ny, nx) = shape``, ny is the number of rows of the grid, and nx the number of columns to sweep over. If
    `periodic`, nx is the period of the kernel.

    Attributes
    ----------
    length, frequencies : int
        Length Nx of the transforms in x, and number F of their frequencies.
    reach : ndarray, shape (chunks,)
        Lag (distance in rows) beyond which the kernel is negligible.
    chunks : list of int
        Entry k is the number of chunks that a transfer of 2^k leaves needs; these are the first chunks.
    edges : list of (int, int)
        First and end chunk of each rank. The first chunk of this rank is `first`.
    near : ndarray
        Kernel between the rows of a leaf and the rows of the leaf before.
    ring : ndarray, shape (2, chunks, leaf rows, LANES)
        The last two leaves, transformed in x.
    stored : ndarray, shape (leaves, own chunks, leaf rows, LANES)
        For each leaf: the effects of earlier leaves until it is solved, then the solved rows.
    transfers : list of tuple
        Entry k has spectra of the kernel, FFT plans and work arrays for transfers of 2^k leaves.
    """

    def __init__(self, quadrant_rows, shape, comm, periodic):
        self.shape = ny, nx = shape
        self._fftw = FFTW(np.dtype(float))
        size, rank = (1, 0) if comm is None else (comm.size, comm.rank)
        rows = self.leaf_rows = -(-min(ny, LEAF_ROWS[size > 1]) // TILE) * TILE
        self.leaves = -(-ny // rows)
        kernel = KernelInX(quadrant_rows, shape, comm, periodic)
        self.length, self.frequencies = kernel.length, kernel.frequencies
        chunks = -(-self.frequencies // LANES)
        self.reach = kernel.reach[::LANES].copy()

        # Transfers of 2^k leaves are needed for lags up to rows (2^k + 1), none for lags up to rows.
        levels = range(max(self.leaves - 2, 0).bit_length())
        served = [rows] + [rows * ((1 << k) + 1) for k in levels]
        self.chunks = [int(np.count_nonzero(self.reach > lag)) for lag in served[: len(levels)]] + [0]
        weights = sum((np.arange(self.chunks[0]) < n for n in self.chunks), np.ones(self.chunks[0]))
        self.edges = deal_chunks(weights, size)
        self.first, last = self.edges[rank]

        self.near = self.ring = self.rows = None
        if rank == 0:
            near = np.zeros((2 * rows, chunks * LANES))
            near[:, : self.frequencies] = kernel.rows(0, 2 * rows)
            self.rows = self._prepare_rows(quadrant_rows(slice(0, 1), nx)[0], near[:TILE])
            near = near.reshape(-1, chunks, LANES).transpose(1, 0, 2)
            self.near = np.repeat(near, 2, axis=2).reshape(-1)  # for Re and Im
            self.ring = np.zeros((2, chunks, rows, LANES), complex)
        self.stored = np.zeros((self.leaves, last - self.first, rows, LANES), complex)
        self.transfers = self._prepare_transfers(kernel)
        self._weight = None

    @staticmethod
    def _with_spectrum(length):
        """Return an array for in-place transforms, and its spectrum in the same memory."""
        spectrum = aligned(length // 2 + 1, complex)
        return spectrum.view(float), spectrum

    def _prepare_rows(self, first_row, close):
        """Return a `RowSolver`, given influence coefficients within a row."""
        nx, length = self.shape[1], self.length
        cells, _ = self._with_spectrum(length)
        solved, _ = self._with_spectrum(length)
        tile = aligned((TILE, close.shape[1]), complex)
        plans = [
            (self._fftw.plans(solved[None], row, length)[0], self._fftw.plans(cells[None], row, length)[1])
            for row in tile[:, None, : self.frequencies]
        ]

        levels = 0
        while nx > SEGMENT_COLUMNS << levels:
            levels += 1
        segment = -(-nx // (1 << levels))
        lengths = [transform_length(segment << level) for level in range(levels)]
        spectra = [rfft(first_row[:n], n) / n for n in lengths]
        if nx >= MIN_RUN:  # lengths for whole runs
            runs = [n << k for k in range(nx.bit_length()) for n in (256, 384) if n << k >= 2 * MIN_RUN]
            lengths += runs[: np.searchsorted(runs, 2 * nx) + 1]
        starts = np.cumsum([0] + [n // 2 + 1 for n in lengths])
        spectra = np.concatenate([*spectra, np.zeros(starts[-1] - starts[levels], complex)])
        work, work_spectrum = self._with_spectrum(max(lengths, default=2))
        part_plans = [self._fftw.plans(work[None], work_spectrum[None], n) for n in lengths]
        return RowSolver(
            execute=self._fftw.execute, plans=np.array(plans, np.int64), cells=cells, solved=solved,
            tile=tile.view(float), close=np.repeat(close, 2, axis=1), contact=np.zeros(nx, np.int64),
            kernel=first_row, reverse=first_row[::-1].copy(), segment=segment, levels=levels,
            lengths=np.array(lengths, np.int64), starts=starts, spectra=spectra,
            part_plans=np.array(part_plans, np.int64).reshape(-1, 2), work=work, work_spectrum=work_spectrum,
            added=np.empty(TILE * 2 * LANES),
        )  # fmt: skip

    def invert_triangle(self, weight):
        """Compute the spectra that solve rows whose contact has no holes.

        Such a row is multiplied by the inverse of the Toeplitz matrix ``I / weight + L``. L couples a cell to the cells
        before it in the row, and `weight` is omega divided by the diagonal of A.
        """
        rows, nx = self.rows, self.shape[1]
        if weight == self._weight or len(rows.lengths) == rows.levels:
            return
        self._weight = weight
        column = np.zeros(nx)
        for t in range(nx):
            column[t] = weight * ((t == 0) - np.dot(rows.reverse[nx - 1 - t : nx - 1], column[:t]))
        for number in range(rows.levels, len(rows.lengths)):
            start, n = rows.starts[number], rows.lengths[number]
            rows.spectra[start : start + n // 2 + 1] = rfft(column[: n // 2], n) / n

    def _prepare_transfers(self, kernel):
        """Return spectra, FFT plans and work arrays for each size of transfers."""
        edges = [tuple(min(c * LANES, self.frequencies) for c in edge) for edge in self.edges]
        columns, rows = kernel.columns(edges), self.leaf_rows
        transfers = []
        for level, chunks in enumerate(self.chunks[:-1]):
            length = rows << level + 1
            own = min(max(chunks - self.first, 0), self.stored.shape[1])
            far = np.zeros((own, LANES, length // 2 + 1), complex)
            part = columns[: own * LANES, rows : rows + length]
            far.reshape(-1, far.shape[2])[: len(part)] = rfft(part, length) / length
            batch = LANES
            while batch > 1 and batch * length > _BATCH:
                batch //= 2
            cells, spectrum = (aligned((batch, length), complex) for _ in range(2))
            plans = self._fftw.plans(cells, spectrum, length)
            transfers.append((far, self._fftw.execute, *plans, cells, spectrum))
        return transfers
