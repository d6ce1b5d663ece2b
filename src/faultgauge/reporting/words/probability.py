"""A probability in words: never certain."""

from faultgauge.detection.posterior.posterior import LIKELY

__all__ = ["probability", "too"]

SURE = 0.999  # nobody's p is told closer to 1


def probability(p: float) -> str:
    """ "0.98", "0.997", "> 0.999": beyond that, what is told rests on the model more than on p."""
    if p > SURE:
        return f"> {SURE:g}"
    if p < 1 - SURE:
        return f"< {1 - SURE:.3g}"
    return f"{p:.3f}" if p > 0.99 else f"{p:.2g}"


def too(name: str, p: float) -> str:
    """ "leak may be there too (p 0.097)", of a fault beside another."""
    return f"{name} {'is likely' if p >= LIKELY else 'may be'} there too (p {probability(p)})"
