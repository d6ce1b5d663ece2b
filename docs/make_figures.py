"""Write docs/fault.svg: the pulse of the measured drive, estimated (needs the EMPS records)."""

from pathlib import Path

import numpy as np

from faultgauge.reporting.time_figures import fault_estimate
from faultgauge_studies.drive import measured_logs, run_drive

logs = measured_logs()
if logs is None:
    raise SystemExit("set FAULTGAUGE_DATA to the folder that holds emps/")
drive = run_drive(logs, "network")
shown = logs.faulty.t < 5.0
found = drive.decision.posterior
figure = fault_estimate(
    logs.faulty.t[shown],
    found.f[shown, 0],
    found.lo[shown, 0],
    found.hi[shown, 0],
    limit=None,
    name="pulse",
    unit="V",
    truth=logs.pulse[shown],
    events=[(e.start, e.end) for e in drive.decision.events if e.end < 5.0],
    not_judged=np.array(drive.decision.status)[shown] == "NOT_JUDGED",
    probable=True,
)
Path(__file__).with_name("fault.svg").write_text(figure.svg)
