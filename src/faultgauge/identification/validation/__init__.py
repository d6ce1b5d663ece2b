"""What a model does on data that it was not fitted to: the tests of a sceptic."""

from faultgauge.identification.validation.validate import (
    OutputValidation,
    Validation,
    errors_of,
    tested,
    validate,
)

__all__ = ["OutputValidation", "Validation", "errors_of", "tested", "validate"]
