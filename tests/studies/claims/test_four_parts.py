"""The plant of Fig 2, its parts, and whether they are fitted apart."""

import copy

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultgauge.identification.equation.fit import GroupReport
from faultgauge.identification.equation.groups import Group, groups
from faultgauge.identification.fit import FitReport, fit
from faultgauge.identification.optimise.levenberg_marquardt import Solution
from faultgauge.identification.samples import Samples
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge_studies.paper.claims import four_parts
from faultgauge_studies.paper.claims.four_parts import (
    PARTS,
    READERS,
    moved,
    share_following,
)
from faultgauge_studies.paper.claims.four_parts_plant import (
    PLANT,
    SUMMED,
    TRUE,
    excited,
    gray_box,
    inside,
    part_errors,
    part_values,
    samples_of,
    spoilt,
    true_plant,
)
from faultgauge_studies.paper.reproduce import over_seeds

ROUNDING = 1e-12  # of values up to 120


def by_hand(F, v, u, dv):
    return np.stack(
        [
            (60 * np.tanh(u / 3) - F) / 0.5,
            (F - 8 * v - 10 * v**3 - 2 * np.tanh(10 * v)) / 4,
            6 * np.tanh(F / 40),
            dv / 2 + 0.1 * dv * v + 0.3 * v * v,
        ],
        axis=1,
    )


@pytest.fixture(scope="module")
def log():
    return excited(true_plant(), 0)


def made_up(samples=200):
    rng = np.random.default_rng(0)
    F, v, u = rng.normal(size=(3, samples)) * np.array([[20.0], [1.0], [2.0]])
    dF, dv = rng.normal(size=(2, samples)) * np.array([[50.0], [3.0]])
    return Samples(
        np.stack([F, v], axis=1), u[:, None], np.stack([dF, dv], axis=1), np.empty((samples, 0))
    )


def test_parts_by_hand():
    points = made_up()
    wanted = by_hand(*points.x.T, points.u[:, 0], points.dx[:, 1])
    np.testing.assert_allclose(part_values(true_plant(), points), wanted, rtol=0, atol=ROUNDING)


def test_the_log_is_the_plant_as_scipy_runs_it(log):
    t, columns = log.t, log.columns
    assert len(t) == 2000
    assert set(columns) == {"u", "F", "v", "d_F", "d_v", "s", "a"}
    assert columns["F"][0] == columns["v"][0] == 0.0
    assert np.abs(columns["u"]).max() <= 5.0
    x, reached = np.zeros(2), []
    for k in range(100):
        reached.append(x)
        u = np.array([columns["u"][k]])
        x = solve_ivp(
            lambda _, x, u=u: by_hand(x[:1], x[1:], u, x[1:])[0, :2],
            (0.0, 0.1),
            x,
            rtol=1e-10,
            atol=1e-10,
        ).y[:, -1]
    # RK4 in steps of 5 ms where the fastest rate, of dry drag, is (8 + 2/0.1)/4 = 7 1/s:
    # 0.035^4/120 is 1e-8 of what happens in a time constant; v**3 and the bends of tanh add some
    np.testing.assert_allclose(
        np.stack([columns["F"], columns["v"]], axis=1)[:100], reached, rtol=0, atol=1e-6
    )
    values = by_hand(columns["F"], columns["v"], columns["u"], columns["d_v"])
    logged = np.stack([columns[name] for name in ("d_F", "d_v", "s", "a")], axis=1)
    np.testing.assert_allclose(logged, values, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(samples_of(log, true_plant()).dx, logged[:, :2])


def test_each_part_is_a_group_unless_two_share_an_equation():
    spec = gray_box().spec
    found = groups(spec, spec.signals.output_names)
    assert [group.networks for group in found] == [("f1",), ("f2",), ("f3",), ("f4",)]
    assert [(group.states, group.outputs) for group in found] == [
        ((0,), ()),
        ((1,), ()),
        ((), (0,)),
        ((), (1,)),
    ]
    summed = gray_box(SUMMED).spec
    found = groups(summed, summed.signals.output_names)
    assert {group.networks for group in found} == {("f1", "f2"), ("f3",), ("f4",)}


def test_the_model_has_the_plants_own_integrators():
    assert gray_box().signals == true_plant().signals


def test_an_error_in_one_part_is_that_parts():
    wrong = TRUE | {"f3": "6*tanh(F/40) + 0.25"}
    learned = GrayBoxPlant.untrained(parse_plant(PLANT.format(**wrong), "wrong"))
    points = made_up()
    found = part_errors(true_plant(), learned, points)
    force = points.x[:, 0]
    span = 6 * (np.tanh(force.max() / 40) - np.tanh(force.min() / 40))
    wanted = {"rmse": 0.25, "rmse_share": 0.25 / span, "largest_share": 0.25 / span}
    assert found["f3"] == pytest.approx(wanted, rel=1e-12)  # roundings
    for part in ("f1", "f2", "f4"):
        assert set(found[part].values()) == {0.0}


def test_inside_is_the_box_of_the_trained_points():
    def points(F, v, u, dv):
        columns = np.array([F, v, u, dv], float)
        return Samples(
            columns[:2].T, columns[2:3].T, columns[[3, 3]].T, np.empty((len(columns[0]), 0))
        )

    trained = points([-1, 1], [-2, 2], [-3, 3], [-4, 4])
    fresh = points([0, 1, 1.1, 0, 0, 0], [0, 2, 0, 2.1, 0, 0], [0, 3, 0, 0, -3.1, 0], [0, 4] * 3)
    fresh.dx[5] = 4.1
    assert inside(trained, fresh).tolist() == [True, True, False, False, False, False]


def test_the_error_that_follows_a_point_outside():
    """Outside at 100 and 110; dt = 0.1 s, so up to sample 130 is within 2 s."""
    known = np.ones(1000, bool)
    known[[100, 110]] = False
    error = np.zeros(1000)
    error[[99, 100, 130, 131]] = [1.0, 2.0, 3.0, 4.0]
    assert share_following(error, known) == pytest.approx((4 + 9) / 30, rel=1e-12)  # roundings
    assert share_following(error, np.ones(1000, bool)) == 0.0


def test_noise_spoils_one_column(log):
    found = spoilt(log, "d_v", 3)
    added = found.columns["d_v"] - log.columns["d_v"]
    # the standard deviation of 2000 normal numbers is known to 1/sqrt(4000) = 1.6 %: five of them
    assert np.std(added) == pytest.approx(0.1 * np.std(log.columns["d_v"]), rel=0.08)
    for name in log.columns:
        assert np.array_equal(found.columns[name], log.columns[name]) == (name != "d_v")
    np.testing.assert_array_equal(spoilt(log, "d_v", 3).columns["d_v"], found.columns["d_v"])


def test_moved_is_the_largest_change_of_a_weight():
    def report(*thetas):
        reports = []
        for name, theta in zip(("f1", "f2"), thetas, strict=True):
            empty = np.zeros(2)
            solution = Solution(np.array(theta), empty, empty, empty, empty, empty)
            reports.append(GroupReport(Group((0,), (), (name,), ()), solution, empty, 0))
        return FitReport(reports, made_up(), [], {}, [])

    before = report([[1.0, 2.0], [3.0, 4.0]], [[5.0], [6.0]])
    after = report([[1.0, 2.0], [3.5, 3.25]], [[5.0], [6.0]])
    assert moved(before, after) == {"f1": 0.75, "f2": 0.0}


@pytest.mark.study
def test_a_part_is_fitted_from_its_own_columns_alone(log):
    """The product's fit, on a short record: a column that a part does not read moves no bit."""

    def short(run):
        return Run(run.name, run.source, run.t[:300], {n: x[:300] for n, x in run.columns.items()})

    plant, held = gray_box(), short(excited(true_plant(), 1))
    model, before = fit(plant, [short(log)], [held], restarts=1)
    after = fit(plant, [short(spoilt(log, "d_v", 0))], [held], restarts=1)[1]
    found = moved(before, after)
    assert {part for part, change in found.items() if change > 0} == {"f2", "f4"}
    learned = part_values(model.plant, samples_of(short(log), plant))
    wanted = part_values(true_plant(), samples_of(short(log), plant))
    # smooth parts in 10 units; 300 samples and one start gave 4e-4 of what a part spans
    assert (np.abs(learned - wanted).max(axis=0) < 0.01 * np.ptp(wanted, axis=0)).all()


def verdict(**changes):
    figures = {
        "groups": 4.0,
        "most_networks_in_a_group": 1.0,
        "fresh_outside_share": 0.01,
        "free_run": {name: {"r2": 0.99995} for name in ("s", "a", "F", "v")},
        "part": {part: {"rmse_share": 0.009} for part in PARTS},
        "moved_by_noise_on": {
            column: {part: float(part in parts) for part in PARTS}
            for column, parts in READERS.items()
        },
    }
    other = copy.deepcopy(figures)
    for path, value in changes.items():
        *most, last = path.split("__")
        place = other
        for name in most:
            place = place[name]
        place[last] = value
    some, every = over_seeds([figures, figures, other]), over_seeds([other])
    return tuple(four_parts.verdict({"four_parts": found}).found for found in (some, every))


def test_the_verdict_follows_the_numbers():
    assert all("The claim holds in every seed." in text for text in verdict())
    for change in ({"free_run__v__r2": 0.9998}, {"part__f3__rmse_share": 0.011}):
        some, every = verdict(**change)
        assert "The claim holds in the median; in some seeds" in some
        assert "The claim fails: the parts are fitted apart, but" in every
    for change in (
        {"groups": 3.0},
        {"most_networks_in_a_group": 2.0},
        {"moved_by_noise_on__s__f1": 1e-9},
        {"moved_by_noise_on__s__f3": 0.0},  # noise that nobody sees proves nothing
    ):
        assert all(
            "The claim fails: the parts are not fitted apart" in x for x in verdict(**change)
        )
