"""What drifts in a log, and what to do about it."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from faultgauge.detection.calibration.drift import Drift
from faultgauge.detection.words import amount, number

__all__ = ["as_dicts", "sentences"]


def sentences(found: Sequence[Drift]) -> list[str]:
    """What drifts, and what to do about it."""
    return [_sentence(each) for each in found]


def _sentence(found: Drift) -> str:
    where = f"run {found.run}: {found.channel}"
    moved = amount(found.change, found.lo, found.hi, found.unit)
    if found.cause == "constant":
        return (
            f"{where} ends {moved} off its usual value, further than healthy runs differ "
            f"(p {found.p:.1g}): it may have taken up what the plant file does not declare; if the "
            "plant is sound, calibrate with this log, too."
        )
    did = "stands at" if found.standing else "moved by"
    over = f"over {number(found.seconds, 4)} s of healthy samples (p {found.p:.1g})"
    said = f"{where} {did} {moved} {over}"
    match found.cause:
        case "plant":
            why = "the plant drifts, apart from any fault; fit again on recent healthy logs"
        case "model":
            why = (
                f"it goes with {found.follows}, so the model lacks this; fit again with logs that "
                f"cover it, or with {found.follows} in a network"
            )
        case "ambiguous":
            why = (
                "a drift of the plant or a slow fault, which these data cannot tell apart; if the "
                "plant is sound, fit again on recent healthy logs"
            )
    return f"{said}: {why}."


def as_dicts(found: Sequence[Drift]) -> list[dict[str, Any]]:
    """Drifts as plain JSON."""
    return [asdict(each) | {"sentence": _sentence(each)} for each in found]
