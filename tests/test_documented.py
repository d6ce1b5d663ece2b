"""What is offered is documented: every public definition, and every argument of the Python API."""

import ast
import inspect
import re
import runpy
from pathlib import Path

import pytest

import faultgauge as fg
from faultgauge.verbs.result import Result

ROOT = Path(fg.__file__).parent
REGISTER = Path(__file__).parents[1] / "docs" / "constants.py"
# what verbs give, whose members a notebook completes
GIVEN = {
    each.__name__: each
    for verb in ("calibrate", "check", "detectability", "estimate", "evaluate", "fit", "rehearse")
    for each in vars(inspect.getmodule(getattr(fg, verb))).values()
    if inspect.isclass(each) and issubclass(each, Result) and each is not Result
}


def offered(tree):
    lists = [
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__"
    ]
    return set(ast.literal_eval(lists[0])) if lists else set()


def test_every_public_definition_has_a_docstring():
    lacking = []
    for path in sorted(ROOT.rglob("*.py")):
        tree = ast.parse(path.read_text())
        public = offered(tree)
        defined = [
            node
            for node in tree.body
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name in public
        ]
        lacking += [
            f"{path.relative_to(ROOT)}: {getattr(node, 'name', 'the module')}"
            for node in (tree, *defined)
            if not ast.get_docstring(node) and tree.body
        ]
    assert not lacking


def members(kind):
    """Public functions and properties of a class, with their documentation, their own or that of
    what they override."""
    for name in dir(kind):
        found = inspect.getattr_static(kind, name)
        if not name.startswith("_") and (
            inspect.isfunction(found) or isinstance(found, property | staticmethod | classmethod)
        ):
            yield name, getattr(kind, name)


@pytest.mark.parametrize("kind", [fg.Plant, fg.Watch, *GIVEN.values()])
def test_every_member_of_a_class_that_users_meet_is_documented(kind):
    assert not [name for name, found in members(kind) if not inspect.getdoc(found)]


def arguments():
    """(whose, argument, documentation) of all that the package offers."""
    for name in fg.__all__:
        found = getattr(fg, name)
        calls = dict(members(found)) if inspect.isclass(found) else {name: found}
        if inspect.isclass(found) and "__init__" in vars(found):
            calls[name] = found
        for own, call in calls.items():
            if not callable(call):
                continue
            whole = (inspect.getdoc(call) or "") + (inspect.getdoc(found) or "")
            for each in inspect.signature(call).parameters:
                if each != "self":
                    yield f"{name}.{own}" if own != name else name, each, whole


def test_every_number_that_was_set_by_hand_says_what_it_means():
    found = [*runpy.run_path(str(REGISTER))["hand_set"]()]
    assert len(found) > 500
    assert [each.where for each in found if not each.meaning] == []


def test_every_argument_of_the_python_api_is_spoken_of():
    # x, u, dx and y are those of the class' own equation
    silent = [
        f"{whose}({argument})"
        for whose, argument, text in arguments()
        if not re.search(rf"`{argument}\b", text) and argument not in ("x", "u", "dx", "y")
    ]
    assert silent == []
