"""How a log is refused: in one sentence that names it."""

from pathlib import Path

import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import read_telemetry


def refusal(path: Path, **options) -> str:
    with pytest.raises(InputError) as caught:
        read_telemetry(path, **options)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert message.endswith(".")
    return message
