"""What heads the answers of a model that errs by more than it explains."""

from dataclasses import replace

import numpy as np
import pytest

from calibrations import LEVEL, for_bank
from faultgauge.detection.answer.reliance import errs_by
from faultgauge.plants.model import Model
from faultgauge.plants.record import Metrics
from faultgauge.reporting.report import render
from faultgauge.reporting.words.hindsight import sentences
from faultgauge.reporting.words.reliance import doubt, headed
from faultgauge.verbs.estimate import estimate
from models import as_stated
from scenes import NOISE, SCENES, TANK

HEAD = "Little to rely on: "
WHY = (
    "little to rely on, as the model does not follow its own healthy logs: its free run is 80 % "
    "off, and its error is 2 times what it explains of d(x)"
)
MOVED = 0.5  # m/s: of u - 0.2 x over the envelope below


def tank(size, lasting=1e9, off=0.8):
    """The tank, two points of whose envelope are 2 MOVED apart, with an error of its own and a free
    run that was `off` by so much."""
    stated = as_stated(TANK, np.array([[0.0, 0.0], [0.0, 2 * MOVED]]))
    metrics = Metrics(validation_free_run_nrmse=off)
    model = Model(stated.plant, stated.record.model_copy(update={"metrics": metrics}))
    levels = NOISE._replace(size=np.array([size]), lasting=np.array([lasting]))
    sizes = {"leak": 0.2, "gauge": 0.5, "weak": 0.2}
    return for_bank(model, levels, size=sizes, memory_s=10.0, block_s=50.0)


def test_the_share_is_that_of_what_stays_for_a_memory():
    """By simulation: the mean over 10 s of a Gauss-Markov process that lasts 2 s."""
    rng, step, count = np.random.default_rng(0), 0.05, 400_000
    fade = np.exp(-step / 2.0)
    kicks = np.sqrt(1 - fade**2) * rng.standard_normal(count)
    d = np.zeros(count)
    for k in range(1, count):
        d[k] = fade * d[k - 1] + kicks[k]
    sd = np.std(d.reshape(-1, round(10.0 / step)).mean(axis=1))  # of 2000 means: known to 1.6 %
    assert errs_by(tank(MOVED, 2.0))["x"] == pytest.approx(sd, rel=0.05)
    assert errs_by(tank(MOVED))["x"] == pytest.approx(1.0)
    assert errs_by(tank(MOVED, 1e5 * LEVEL["memory_s"]))["x"] == pytest.approx(1.0)


def test_a_model_that_explains_more_than_it_errs_by_has_no_head():
    assert doubt(tank(0.9 * MOVED)) is None
    assert headed(tank(0.9 * MOVED), "leak") == "leak"
    assert headed(tank(2 * MOVED), "leak") == f"{HEAD}leak"
    # a sentence goes on with a small letter
    assert headed(tank(2 * MOVED), "No fault") == f"{HEAD}no fault"


def test_a_model_whose_free_run_followed_is_not_doubted():
    """What it errs by may be as quick as it is large."""
    assert doubt(tank(2 * MOVED, off=0.3)) is None
    assert doubt(tank(2 * MOVED, off=None)) is None  # nobody fitted it


@pytest.mark.study  # test_one_source.py goes through the views
def test_every_view_of_a_doubtful_model_begins_with_it():
    """Terminal, hindsight, JSON and report; the fault is as large as the error."""
    suspect = SCENES["a leak that ends"]()
    suspect.columns["x"] = suspect.columns["x"] + 40.0 * (suspect.t >= 300)
    found = estimate(tank(2 * MOVED), replace(suspect), smooth=True)
    plain = found.as_dict()
    # why, once in each view
    assert plain["doubt"] == WHY
    assert found.warnings.count(WHY) == 1
    told = [*found.lines[:1], *found.sentences, *plain["answer"]]
    told += [each["sentence"] for each in plain["events"]]
    told += [each["sentence"] for run in plain["runs"].values() for each in run["unnamed"]]
    told += sentences(found.bank, found.decisions, found.hindsight())
    assert plain["events"]
    assert all(each.startswith(HEAD) for each in told)
    assert found.page().summary_sentences[0].startswith(HEAD)
    assert found.page().summary_sentences.count(f"L{WHY[1:]}.") == 1
    assert "does not follow its own healthy logs" in render(found.page())
