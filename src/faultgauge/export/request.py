"""What an export target is asked for."""

from dataclasses import dataclass

from faultgauge.export.compile import ExportedStep

__all__ = ["Request"]


@dataclass(frozen=True)
class Request:
    """One export: the `step`, which takes a sample every `period` [s], the `name` of its files and
    functions, in which numbers; `title` and `about` say what it is, `digest` is the SHA-256 of the
    model file."""

    step: ExportedStep
    period: float
    name: str
    title: str
    about: str
    digest: str
    single: bool
    fast_tanh: bool
