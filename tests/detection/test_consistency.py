"""When an explanation is no longer told, by hand."""

import jax.numpy as jnp
import numpy as np

from faultgauge.detection.posterior.consistency import Consistency, limit_of
from faultgauge.observers.branches import BranchInfo

HOLDS = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0, 0]], float)  # none, a, b, both, undeclared
A, B = [0.1, 0.7, 0.1, 0.05, 0.05], [0.1, 0.1, 0.7, 0.05, 0.05]
NEITHER, UNKNOWN = [0.6, 0.3, 0.05, 0.0, 0.05], [0.1, 0.0, 0.0, 0.0, 0.9]
UNSURE = [0.2, 0.2, 0.2, 0.2, 0.2]
ONLY_A = [0.1, 0.75, 0.0, 0.0, 0.15]
SURELY_A, SURELY_B = [0.01, 0.99, 0.0, 0.0, 0.0], [0.01, 0.0, 0.99, 0.0, 0.0]
LOST = [0.01, 0.0, 0.0, 0.0, 0.99]
WELL, BADLY, LATELY = [1.0, 1.0], [2.1, 0.0], [0.0, 1.6]
WINDOW = 10.0
ALIKE, APART = (1.0, 1.0), (1 / 64, 1 / 4)  # 1/s: names may change as they like, and may not


def told(rows, limit=(2.0, 1.5), memory=0.0, faulty=1.0, active=(True, True), rates=ALIKE):
    """What is told of rows (t, nis, p) or (t, nis, p, sizes of a and b)."""
    each = Consistency(
        np.array(limit), np.asarray(memory), *[np.asarray(WINDOW)] * 2,
        np.array(rates), np.full(2, memory / 4), HOLDS, np.array(active),
    )  # fmt: skip
    state, found, before = each.init(), [], 0.0
    for t, nis, p, *size in rows:
        f = jnp.broadcast_to(jnp.array(size[0] if size else (1.0, 1.0)), HOLDS.shape)
        said = BranchInfo(jnp.array(p), f, *[jnp.zeros(1)] * 11, jnp.array(nis), faulty)
        state, said = each.step(state, jnp.asarray(t - before), said)
        before = t
        found.append(np.asarray(said.p))
    return found


def test_limits_are_four_times_as_far_above_the_median_as_the_worst():
    nis = np.array([[1.0, 0.5], [1.2, 0.5], [0.9, 0.6], [1.0, 0.7], [2.0, 0.6]])
    np.testing.assert_allclose(limit_of(nis), [1.0 + 4 * 1.0, 0.6 + 4 * 0.1])


def test_what_explains_too_little_is_not_told():
    """In either window, for 10 s more, the longer window; what no fault is likely by stays."""
    for nis in (BADLY, LATELY):
        rows = [(0.0, WELL, A), (5.0, nis, A), (6.0, WELL, B), (14.9, WELL, NEITHER)]
        found = told([*rows, (15.1, WELL, A)])
        np.testing.assert_allclose(found[0], A)
        np.testing.assert_allclose(found[1:3], [UNKNOWN] * 2)
        np.testing.assert_allclose(found[3], [0.6, 0, 0, 0, 0.4])
        np.testing.assert_allclose(found[4], A)


def test_what_comes_and_goes_for_long_is_not_over_for_as_long():
    """Seen at 0, 8, 16 and 24 s: nothing is told until 48 s, as it lasted for 24 s. The fault that
    is likely by turns has not come with it."""
    rows = [(t, BADLY if t <= 24 else WELL, B if k % 2 else A)
            for k, t in enumerate([0.0, 8.0, 16.0, 24.0, 30.0, 47.9, 48.1])]  # fmt: skip
    found = told(rows)
    np.testing.assert_allclose(found[:6], [UNKNOWN] * 6)
    np.testing.assert_allclose(found[6], A)


def test_a_fault_that_stays_is_told():
    """From a window on, alone, as what is beside it has not lasted; again, and another one, that
    come after 12 and 25 s, when they have been likely for as long."""
    rows = [(0.0, BADLY, A), (9.9, BADLY, A), (10.0, BADLY, A), (11.0, BADLY, NEITHER)]
    rows += [(12.0, BADLY, A), (23.9, BADLY, A), (24.0, BADLY, A)]
    rows += [(25.0, BADLY, B), (49.9, BADLY, B), (50.0, BADLY, B)]
    found = told(rows)
    np.testing.assert_allclose(found[:2], [UNKNOWN] * 2)
    np.testing.assert_allclose(found[2], ONLY_A)
    np.testing.assert_allclose(found[3], [0.6, 0, 0, 0, 0.4])
    np.testing.assert_allclose(found[4:6], [UNKNOWN] * 2)
    np.testing.assert_allclose(found[6], ONLY_A)
    np.testing.assert_allclose(found[7:9], [UNKNOWN] * 2)
    np.testing.assert_allclose(found[9], [0.1, 0, 0.75, 0, 0.15])


def test_without_limits_all_is_told():
    (found,) = told([(0.0, [1e9, 1e9], A)], limit=(np.inf, np.inf))
    np.testing.assert_allclose(found, A)


def test_what_a_fault_leaves_for_less_than_a_memory_and_what_none_leaves_is_no_misfit():
    """As a fault comes or goes, before it is known."""
    rows = [(0.0, BADLY, A), (1.9, BADLY, A), (2.0, WELL, A), (3.0, BADLY, A), (4.9, BADLY, A)]
    np.testing.assert_allclose(told(rows, memory=2.0), [A] * 5)
    np.testing.assert_allclose(told([*rows, (5.0, BADLY, A)], memory=2.0)[-1], UNKNOWN)
    np.testing.assert_allclose(told([*rows, (5.0, BADLY, A)], faulty=0.0)[-1], A)


def test_passive_faults_raise_no_alarm_by_what_they_leave():
    """What b, a passive fault, is likely by becomes none's, or b's once it has lasted; a beside it
    stays an alarm."""
    found = told([(0.0, BADLY, B), (10.0, BADLY, B)], active=(True, False))
    np.testing.assert_allclose(found, [[0.8, 0, 0, 0, 0.2], [0.1, 0, 0.7, 0, 0.2]])


def in_turn(*causes, each):
    """Rows of causes (p, sizes) that take each other's place, every one for `each` memories."""
    return [
        (float(n * each + t), WELL, *cause) for n, cause in enumerate(causes) for t in range(each)
    ]


def test_names_that_take_each_others_place_too_fast_are_not_told():
    """Every one after the first adds 2 ln(64 / 4) = 5.545, and a memory takes 1/4 - 1/64 = 0.234
    off. Odds of 19 against what is 100 times as rare are ln 1900 = 7.550: from the third on where
    each lasts 8 memories, 11.09 - 1.88 = 9.21, and not where it lasts 16, 11.09 - 3.75 = 7.34."""
    a, b = (SURELY_A, (1.0, 1.0)), (SURELY_B, (1.0, 1.0))
    found = told(in_turn(a, b, a, each=8), memory=1.0, rates=APART)
    np.testing.assert_allclose(
        found[:17], [*[SURELY_A] * 8, *[SURELY_B] * 8, SURELY_A]
    )  # a row until it counts
    np.testing.assert_allclose(found[17:], [LOST] * 7)
    found = told(in_turn(a, b, a, each=16), memory=1.0, rates=APART)
    np.testing.assert_allclose(found, [*[SURELY_A] * 16, *[SURELY_B] * 16, *[SURELY_A] * 16])


def test_what_comes_once_nothing_has_been_the_matter_for_a_memory_takes_no_ones_place():
    """Faults one after the other, as in a rehearsal; the same is too much where a fault, or none,
    is likely for less than a memory."""
    a, b, none = (SURELY_A, (1.0, 1.0)), (SURELY_B, (1.0, 1.0)), (NEITHER, (0.0, 0.0))
    for lasts, pause, told_last in ((3, 4, SURELY_A), (2, 4, LOST), (3, 3, LOST)):
        causes = [(a, lasts), (none, pause), (b, lasts), (none, pause), (a, lasts)]
        every = [cause for cause, rows in causes for _ in range(rows)]
        rows = [(float(t), WELL, *cause) for t, cause in enumerate(every)]
        found = told(rows, memory=2.5, rates=APART)
        np.testing.assert_allclose(found[-1], told_last)


def test_the_same_name_again_is_no_change_whatever_comes_beside_it():
    """a goes, comes back with b, and is alone again: b's place is taken by nobody."""
    one = (1.0, 1.0)
    both = [0.01, 0.0, 0.0, 0.99, 0.0]
    rows = in_turn((SURELY_A, one), (both, one), (SURELY_A, one), (both, one), each=3)
    rows = [(*row[:2], UNSURE, one) if row[0] % 3 == 0 else row for row in rows]
    np.testing.assert_allclose(told(rows, memory=1.0, rates=APART)[-1], both)


def test_a_fault_that_comes_and_goes_is_told_and_one_that_turns_its_sign_is_not():
    """An intermittent one; in place of the second a fault of the other direction."""
    none = (NEITHER, (0.0, 0.0))
    up, down = (SURELY_A, (1.0, 1.0)), (SURELY_A, (-1.0, 1.0))
    found = told(in_turn(up, none, up, none, up, none, up, each=3), memory=1.0, rates=APART)
    np.testing.assert_allclose(found[-3:], [SURELY_A] * 3)
    found = told(in_turn(up, down, up, down, each=3), memory=1.0, rates=APART)
    np.testing.assert_allclose(found[-3:], [LOST] * 3)


def test_what_takes_its_place_is_told_once_it_has_stayed():
    """From the third name on, at 9 s, none is; the fourth, b, is likely from 12 s on, and told 10 s
    later, which is the window."""
    a, b = (SURELY_A, (1.0, 1.0)), (SURELY_B, (1.0, 1.0))
    rows = [*in_turn(a, b, a, each=4), *((float(t), WELL, *b) for t in range(12, 80))]
    found = told(rows, memory=1.0, rates=APART)
    np.testing.assert_allclose(found[9:22], [LOST] * 13)
    np.testing.assert_allclose(found[22:], [SURELY_B] * 58)
