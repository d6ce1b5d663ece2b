"""Figures as text."""

from typing import Any

__all__ = ["amount", "share"]


def share(found: dict[str, Any]) -> str:
    """What `scoring.wilson` found, like: 5 of 6 (83.3% [43.6%, 97.0%])"""
    if not found["of"]:
        return "none"
    ends = f"[{found['lo']:.1%}, {found['hi']:.1%}]"
    return f"{found['hits']} of {found['of']} ({found['share']:.1%} {ends})"


def amount(value: float | None, style: str) -> str:
    return "none" if value is None else format(value, style)
