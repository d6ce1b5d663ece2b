"""The chapter on the refinement says what was found, and how surely."""

from dataclasses import replace

import numpy as np

from faultgauge.identification.constants import ConstantsInformation, FittedConstant
from faultgauge.identification.samples import Samples
from faultgauge.identification.simulation_error.courses import Course
from faultgauge.identification.simulation_error.result import Members, Refinement
from faultgauge.plants.gray_box import load_plant
from faultgauge.reporting.refinement_chapter import refinement_section
from faultgauge.reporting.report import Report, render
from faultgauge.reporting.style import quantity


def refinement(choices=None, tried=None, refitted=False):
    plant = load_plant("tank")
    nothing = np.zeros((1, 1))
    training = Samples(nothing, nothing, nothing, nothing)
    constants = (
        FittedConstant("k_in", "m/s/V", 0.0123, 0.0004, None, None),
        FittedConstant("k_out", "m**0.5/s", 0.0, None, "min = 0", "outlet"),
    )
    correlation = np.array([[1.0, -0.75], [-0.75, 1.0]])
    return Refinement(
        plant=plant,
        members=[plant],
        training=training,
        judged=Members([plant], training),
        refitted=refitted,
        error=0.02,
        substeps=1,
        sample_time=0.1,
        choices=choices or {"hold": {}, "hidden": {}},
        tried=tried or [("physics", 0.3), ("networks", np.inf), ("networks", 0.02)],
        chosen="networks",
        information=ConstantsInformation(constants, correlation, (), 12.0),
        warnings=[],
    )


def test_the_numbers_stand_where_they_belong():
    section = refinement_section(refinement())
    parameters, correlations, tried = section.tables
    assert parameters.rows[0][1:3] == (quantity(0.0123, "m/s/V"), quantity(0.0004, "m/s/V"))
    assert parameters.rows[1][2:] == ("", "min = 0", "outlet")
    assert correlations.rows == (("k_in", "k_out", "-0.750"),)
    assert tried.rows == (
        ("networks", "2.000 %"),
        ("physics", "30.000 %"),
        ("networks", "diverges"),
    )
    assert "3 candidates" in section.paragraphs[0]
    assert "kept (networks)" in section.paragraphs[0]
    assert "1 of them diverged" in section.paragraphs[0]
    assert "12 samples as one" in section.paragraphs[1]


def test_what_did_not_happen_is_not_mentioned():
    section = refinement_section(refinement(tried=[("physics", 0.3)]))
    assert "diverged" not in section.paragraphs[0]
    assert len(section.tables) == 3


def test_choices_are_named():
    choices = {"hold": {"u": "linear"}, "hidden": {"outlet": 4}}
    section = refinement_section(refinement(choices))
    assert section.tables[2].rows == (("u", "hold", "linear"), ("outlet", "hidden", "4"))
    page = render(Report("t", ("s",), (section,), versions={}))
    assert "linear" in page


def test_a_fit_to_what_was_held_out_is_told():
    before, after = (refinement_section(refinement(refitted=told)) for told in (False, True))
    assert after.paragraphs[:-1] == before.paragraphs
    assert "was then fitted to those data, too" in after.paragraphs[-1]


def test_a_common_value_has_no_error():
    """Runs have values of their own, which say next to nothing of one that they have in common."""
    own = replace(refinement(), per_run={"k_in": {"monday": 0.01}})
    assert refinement_section(own).tables[0].rows[0][2] == ""


def test_a_drift_is_drawn():
    courses = [Course("monday", [0.0, 10.0], [1.0, 2.0]), Course("friday", [5.0, 20.0], [3.0, 4.0])]
    drifted = replace(refinement(), courses={"k_in": courses})
    (drawn,) = refinement_section(drifted).figures
    assert refinement_section(refinement()).figures == ()
    page = render(Report("t", ("s",), (refinement_section(drifted),), versions={}))
    assert drawn.title == "How k_in drifted"
    assert all(word in page for word in ("monday", "friday"))
