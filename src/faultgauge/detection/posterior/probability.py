"""A probability in words: never certain."""

__all__ = ["probability"]

SURE = 0.999


def probability(p: float) -> str:
    """ "0.98", "0.997", "> 0.999": beyond that, what is told rests on the model more than on p."""
    if p > SURE:
        return f"> {SURE:g}"
    if p < 1 - SURE:
        return f"< {1 - SURE:.3g}"
    return f"{p:.3f}" if p > 0.99 else f"{p:.2g}"
