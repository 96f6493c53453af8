"""The models of the arithmetic coder: their trees are the sums of their counts, also after these were halved."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.codec import kernels


@given(st.integers(1, 40), st.lists(st.integers(0, 39), min_size=120, max_size=200))
def test_the_tree_holds_the_sums_of_the_counts(size: int, ranks: list[int]) -> None:
    fields = np.zeros((1, 8), np.int64)
    fields[0, [kernels.ON, kernels.P_COUNT]] = 1, size
    base, totals = np.zeros(1, np.int64), np.zeros(1, np.int64)
    counts, tree = np.zeros(size + 1, np.int64), np.zeros(size + 1, np.int64)
    kernels.reset_models(fields, base, counts, tree, totals)
    wanted = np.ones(size, np.int64)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernels, "LIMIT", size + 37)
        for rank in ranks:
            if wanted.sum() == size + 37:
                wanted = (wanted + 1) // 2
            wanted[rank % size] += 1
            kernels._count(0, rank % size, fields, base, counts, tree, totals)
    assert counts[1:].tolist() == wanted.tolist()
    assert totals[0] == wanted.sum()
    assert tree[1:].tolist() == [wanted[i - (i & -i) : i].sum() for i in range(1, size + 1)]
    assert [kernels._prefix(0, rank, tree) for rank in range(size + 1)] == [0, *np.cumsum(wanted)]
