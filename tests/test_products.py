import numpy as np
import pytest

from faultgauge.products import contract


@pytest.mark.parametrize(
    "form",
    ["ij,j->i", "ji,j->i", "ij,jk->ik", "ia,ja->ij", "i,i->", "bfk,bks->bsf", "bka,bnka->bn"],
)
def test_a_contraction_is_what_einsum_makes_of_it(form):
    rng = np.random.default_rng(0)
    length = dict(zip("abfijkns", range(2, 10), strict=True))
    left, right = (
        rng.normal(size=[length[k] for k in each]) for each in form.split("->")[0].split(",")
    )
    # sums of at most a hundred products of order 1
    np.testing.assert_allclose(
        contract(form, left, right), np.einsum(form, left, right), rtol=0, atol=1e-13
    )
