"""Transfers of a sweep, dealt to the ranks."""

import numpy as np
import pytest

from app.halfspace.gauss_seidel.pipeline import deal_chunks


@pytest.mark.parametrize("ranks", [1, 2, 3, 5])
@pytest.mark.parametrize("chunks", [0, 1, 7, 40])
def test_every_chunk_has_one_rank_and_rank_0_has_none_of_several(chunks, ranks):
    weights = np.arange(chunks, 0, -1.0)
    edges = deal_chunks(weights, ranks)
    assert len(edges) == ranks
    assert [chunk for first, last in edges for chunk in range(first, last)] == list(range(chunks))
    assert ranks == 1 or edges[0] == (0, 0)
    work = [weights[first:last].sum() for first, last in edges[ranks > 1 :]]
    assert max(work) - min(work) <= 2 * weights.max(initial=0.0)
