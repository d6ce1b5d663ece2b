import jax
import numpy as np
import pytest

from faultgauge.products import TERMS, among, contract
from faultgauge.simulation.lanes import lanes_last

FORMS = ["ij,j->i", "ji,j->i", "i,ij->j", "ij,jk->ik", "ij,kj->ik", "ia,ja->ij", "i,i->",
         "bfk,bks->bsf", "bka,bnka->bn"]  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("longest", [9, TERMS + 1])  # sums that are written out, and that are not
def test_a_contraction_is_what_einsum_makes_of_it(form, longest):
    """Of one and, as lanes, of several at once."""
    rng = np.random.default_rng(0)
    length = dict(zip("abfiknsj", (2, 3, 4, 5, 6, 7, 8, longest), strict=True))
    left, right = (
        rng.normal(size=[*(length[k] for k in each), 3]) for each in form.split("->")[0].split(",")
    )
    wanted = np.stack([np.einsum(form, left[..., k], right[..., k]) for k in range(3)], axis=-1)
    # sums of at most some hundred products of order 1
    near = {"rtol": 0, "atol": 1e-12}
    np.testing.assert_allclose(contract(form, left[..., 0], right[..., 0]), wanted[..., 0], **near)
    many = jax.jit(lambda *given: lanes_last(lambda a, b: contract(form, a, b), *given))
    np.testing.assert_allclose(many(left, right), wanted, **near)


@pytest.mark.parametrize("places", [[], [0, 1, 2], [1, 2, 5], [0, 4, 6], [6]])
def test_columns_stand_among_others(places):
    array = np.random.default_rng(0).normal(size=(2, len(places)))
    wanted = np.zeros((2, 7))
    wanted[:, places] = array
    found = among(jax.numpy.asarray(array), np.array(places, int), 7)
    np.testing.assert_array_equal(found, wanted)
