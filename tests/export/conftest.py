import pytest

from faultgauge.export.native import compiler


@pytest.fixture
def cc():
    """A C compiler."""
    found = compiler()
    if found is None:
        pytest.skip("no C compiler is installed: install gcc or clang, or set CC")
    return found
