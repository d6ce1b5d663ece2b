"""What can go wrong, as a tree.

    FaultgaugeError
    ├── InputError       the user's input is wrong                      exit code 2
    └── InternalError    a promise of ours is broken: a bug             exit code 1

Every message is one plain sentence: what is wrong, where (file, key, row), what is legal and
what to do about it.
"""

__all__ = ["FaultgaugeError", "InputError", "InternalError"]


class FaultgaugeError(Exception):
    """Root of everything that faultgauge raises on purpose."""


class InputError(FaultgaugeError):
    """The user's input is wrong; the message says where and what to do (exit code 2)."""


class InternalError(FaultgaugeError):
    """faultgauge broke one of its own promises (exit code 1)."""
