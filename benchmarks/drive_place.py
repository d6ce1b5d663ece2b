"""Why the bank misses EMPS pulses with friction of speed and place: by the envelope, or by noise?

python benchmarks/drive_place.py [--seeds N]

For each of seeds 0 to N - 1 (by default 3): how far samples lie from what training covered of
(q, v), in ranges, where the pulse is estimated within 0.5 V and where it is not; how many samples
are in the box and in no region; the half periods that are wrong with the body's own process noise
and with that of the body of speed alone. Then how the measured place answers an edge of the pulse:
the second difference over that of a 5 V step, from two samples before the edge on. Set
FAULTGAUGE_DATA to the folder that holds emps/.
"""

import argparse
import sys
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from decision_studies.drive_pulses import (
    SETTLED,
    SHARES,
    Body,
    bodies,
    by_bank,
    trained,
)
from faultgauge.detection.decisions import decide_runs
from faultgauge.detection.rows.judged import operating_points
from faultgauge.plants.gray_box import load_plant
from faultgauge.verbs.checkup import parts
from faultgauge_studies import merit
from faultgauge_studies.drive import PULSE, DriveLogs, measured_logs

PLACED, SPEED = "network of speed and place, 6 units", "network of speed, 6 units"
GOOD = 0.5  # V
SHOWN = 0.5, 0.99, 1.0  # quantiles


def one_seed(logs: DriveLogs, seed: int) -> None:
    plants = bodies()
    placed, speed = (trained(name, plants[name], logs, seed) for name in (PLACED, SPEED))
    last = parts([logs.healthy], *SHARES)[3]
    (_, decision), _ = decide_runs(placed.model, [*last, logs.faulty])
    posterior = decision.posterior
    scored = merit.settled(logs.faulty.t, merit.edges_of(logs.pulse), SETTLED)
    right = np.abs(posterior.f[:, 0] - logs.pulse) < GOOD
    points = operating_points(placed.model).x
    width = np.ptp(points, axis=0)
    away = KDTree(points / width).query(posterior.x / width, p=np.inf)[0]
    print(f"seed {seed}:")
    for name, which in (("within 0.5 V", right), ("not", ~right)):
        each = away[scored & which]
        said = [f"{q:.3f}" for q in np.quantile(each, SHOWN)] if len(each) else []
        print(f"  settled samples {name}: {len(each)}, median, 99 % and most from training: {said}")
    print(f"  in the box and in no region: {int(np.sum(posterior.outside > 1))}")
    own, other = placed.model.calibration, speed.model.calibration
    assert own is not None
    assert other is not None
    mixed = own.model_copy(update={"noise": other.noise})
    swapped = replace(placed, model=placed.model.with_calibration(mixed))
    for name, body in (("own", placed), ("the other body's", swapped)):
        report(name, body, logs)


def report(name: str, body: Body, logs: DriveLogs) -> None:
    found = by_bank(body, logs).figures
    known = body.model.calibration
    assert known is not None
    assert known.noise is not None
    noise = known.noise.process["v"]
    print(
        f"  {name} noise, {noise:.2g} m/s per root second: half periods wrong "
        f"{found['half_periods_wrong']:.0f}, RMSE {found['rmse_share']:.2%}, coverage "
        f"{found['coverage_settled']:.1%}"
    )


def edges(logs: DriveLogs) -> None:
    q, at = logs.faulty.columns["q"], merit.edges_of(logs.pulse)
    plant = load_plant("positioning_drive")
    mass = 95.1  # kg, with which EMPS is published
    step = float(plant.parameters["gtau"]) * PULSE / mass * logs.faulty.step**2
    sign = np.sign(logs.pulse[at] - logs.pulse[at - 1])

    def bend(k: int) -> np.ndarray:
        return q[at + k + 1] - 2 * q[at + k] + q[at + k - 1]

    answer = [float(np.median(sign * (bend(k) - bend(-3)))) / step for k in range(-2, 4)]
    print(f"an edge, from two samples before it on: {[f'{each:.2f}' for each in answer]}")
    print(
        "of a model whose input is held:         ['0.00', '0.00', '0.50', '1.00', '1.00', '1.00']"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    records = measured_logs()
    if records is None:
        sys.exit("set FAULTGAUGE_DATA to the folder that holds emps/")
    for seed in range(given.seeds):
        one_seed(records, seed)
    edges(records)
