"""What is being done, and how much of it is: what a callback `progress` is told."""

__all__ = ["Step"]


class Step(str):
    """A text that knows which `share` of the work is done, 0 to 1."""

    share: float

    def __new__(cls, text: str, share: float) -> "Step":
        step = super().__new__(cls, text)
        step.share = share
        return step
