"""Observers over any `Plant`: one algorithm per file, all with `init` and `step`.

`OBSERVERS` maps the name used by `--observer` to the function that designs one.
"""

from faultgauge.observers.eso import design_eso
from faultgauge.observers.observer import Design, Observer, ObserverInfo, ObserverState, observe

__all__ = ["OBSERVERS", "Design", "Observer", "ObserverInfo", "ObserverState", "observe"]

OBSERVERS = {"eso": design_eso}
