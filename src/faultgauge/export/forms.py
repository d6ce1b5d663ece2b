"""The forms of all operations that can be printed."""

from faultgauge.export.control import CONTROL
from faultgauge.export.formulas import FORMULAS
from faultgauge.export.printing import Forms
from faultgauge.export.reductions import REDUCTIONS
from faultgauge.export.views import VIEWS
from faultgauge.export.written import WRITTEN

__all__ = ["FORMS"]

FORMS = Forms({**VIEWS, **FORMULAS, **REDUCTIONS}, WRITTEN, CONTROL)
