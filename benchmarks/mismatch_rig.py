"""How well faults are named and sized where the plant is not its model.

    python benchmarks/mismatch_rig.py [--case NAME]... [--runs N] [--healthy M] [--quick]
        [--without-discrepancy] [--json FILE]

Each case (`mismatch/`) has a truth that is simulated here, in plain Python, and a plant file that
lacks something of it. The file is fitted to three healthy logs and calibrated on five others, once;
then N logs with faults (by default 100) and M healthy ones (half as many) are judged, and a third
of N in which up to four declared faults follow each other (`mismatch/windows.py`), and as many in
which one jumps from size to size (`mismatch/stairs.py`). Seeds are 0 to N - 1 for each kind of log.
Sizes take turns: engineering ones, about a tenth to a fifth of the range, and 4 and 8 times the
smallest that the model itself says it would tell in such a log, as far as they make sense; faults
in turn have engineering ones. `--without-discrepancy` calibrates without model error. Shares have
Wilson's 95 % intervals.

  heaters         two coupled heaters: radiation, sensor lags, a room that wanders, 0.3 K steps
  biased          the same, of which biases alone are declared
  servo           a position loop whose friction has memory
  tanks2_2        two tanks whose constants differ by 2 % from run to run; coloured noise
  tanks2_5        the same, 5 %
  lag             a lag with another behind it, 0.15 times as long
  slow_sensor     one sensor ten times as slow as the log, rounded; a room that wanders
  meter           a tank whose flow is measured, behind a lag and a supply that wanders
  exchanger       two lumps for a counterflow of cells; a valve's lag, inlets that wander
  battery         a cell with one pair of two, no hysteresis, resistances that warmth lowers
  quad            a quadrotor's height and pitch: rotor lag, a battery that sags, ground, gusts
  ahu             an air handling unit: a curved valve, walls, and people who come and go
  valve           a control valve in a flow loop: a stem that sticks, pressures that wander
  cylinder        a hydraulic position loop: Stribeck's friction, the valve's root and lag
  heated_tank     level and temperature in two loops: a bent valve, a wall, lags
  bench_heaters   a board with two heaters and ten bits: sensors that lag, draughts, a weak supply
  fan_drive       a fan in a speed loop: its speed in coarse steps, filters, a winding that warms
  dc_motor        a speed loop: cogging, Stribeck's friction, a winding that warms, filters
  reaction_wheel  half an hour of a momentum loop: oil that warms, a cage, pulses that are counted
  pump_loop       a pump that fills a vessel: check valve, cut-off, suction that wanders
  pump_station    a sump, a pump, an air vessel, a line: damped sensors, inflow that wanders
  furnace         ten hours of soaks: walls that store, lags, mains that wander
  two_mass        a position loop over a soft coupling with play; ripple, an encoder out of centre
  satellite       an axis with a wheel: a panel that swings, a gyro that drifts, friction
  air             compressed air in two vessels: gas that warms, choked nozzles, a bent valve
  reactor         a cooled tank: Arrhenius, a wall, fouling, a valve of equal percentage
  conveyor        a belt on a drum: creep and slip, a load that strays, a splice, lags
  gimbal          an axis whose bearing sticks and breaks loose; a cable, teeth, a lag
  helicopter      a beam with two rotors in two loops: a slip ring, cables, a supply that droops
  cold_room       a chill store: frost and defrosts, doors, a capacity that bends, goods with a core
  ball_beam       a ball on a beam in a cascade: play, stiction, a track that is bent and noisy
  equal           the heaters without anything that the file lacks
"""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mismatch.ahu import ahu
from mismatch.air import air
from mismatch.ball_beam import ball_beam
from mismatch.battery import battery
from mismatch.bench_heaters import bench_heaters
from mismatch.case import Case
from mismatch.cold_room import cold_room
from mismatch.conveyor import conveyor
from mismatch.cylinder import cylinder
from mismatch.dc_motor import dc_motor
from mismatch.exchanger import exchanger
from mismatch.fan_drive import fan_drive
from mismatch.furnace import furnace
from mismatch.gimbal import gimbal
from mismatch.harness import measure, without_discrepancy
from mismatch.heated_tank import heated_tank
from mismatch.heaters import biased, equal, heaters
from mismatch.helicopter import helicopter
from mismatch.lag import lag
from mismatch.meter import meter
from mismatch.pump_loop import pump_loop
from mismatch.pump_station import pump_station
from mismatch.quad import quad
from mismatch.reaction_wheel import reaction_wheel
from mismatch.reactor import reactor
from mismatch.report import amount, share
from mismatch.satellite import satellite
from mismatch.servo import servo
from mismatch.slow_sensor import slow_sensor
from mismatch.tanks import tanks
from mismatch.two_mass import two_mass
from mismatch.valve import valve

CASES: dict[str, Callable[[], Case]] = {
    "heaters": heaters,
    "biased": biased,
    "servo": servo,
    "tanks2_2": lambda: tanks("tanks2_2", 0.02),
    "tanks2_5": lambda: tanks("tanks2_5", 0.05),
    "lag": lag,
    "slow_sensor": slow_sensor,
    "meter": meter,
    "exchanger": exchanger,
    "battery": battery,
    "quad": quad,
    "ahu": ahu,
    "valve": valve,
    "cylinder": cylinder,
    "bench_heaters": bench_heaters,
    "heated_tank": heated_tank,
    "fan_drive": fan_drive,
    "dc_motor": dc_motor,
    "reaction_wheel": reaction_wheel,
    "pump_loop": pump_loop,
    "pump_station": pump_station,
    "furnace": furnace,
    "two_mass": two_mass,
    "satellite": satellite,
    "air": air,
    "reactor": reactor,
    "conveyor": conveyor,
    "gimbal": gimbal,
    "helicopter": helicopter,
    "cold_room": cold_room,
    "ball_beam": ball_beam,
    "equal": equal,
}
SHARES = {
    "exact": "named exactly",
    "exact_at_end": "right set at the log's end",
    "wrong": "a wrong name",
    "missed": "a fault missed",
    "unknown": "something undeclared told",
    "nameless": "an alarm without a name",
    "early": "an alarm before the onset",
    "healthy_alarm": "healthy logs with an alarm",
    "size_covered": "size inside its interval, of named faults",
    "onset_covered": "onset inside its interval, of named faults",
}
WINDOWS = {
    "exact": "named, and nothing else",
    "named": "named",
    "alarmed": "under alarm",
    "sized": "size inside its interval, of those named",
    "dated": "onset inside its interval, of those named",
}
STAIRS = {
    "told": "told by name in their middle",
    "sized": "size inside its interval",
    "close": "size within a quarter",
    "dated": "onset inside its interval, of those",
}
QUICK = 6


def show(found: dict[str, Any]) -> None:
    print(f"{found['case']}:")
    if "refused" in found:
        print(f"  refused: {found['refused']}")
        return
    for warning in found["warnings"]:
        print(f"  warned: {warning}")
    least = {name: amount(size, ".3g") for name, size in found["smallest"].items()}
    print(f"  smallest sizes, as predicted: {', '.join(f'{n} {s}' for n, s in least.items())}")
    for key, text in SHARES.items():
        print(f"  {text}: {share(found[key])}")
        if key == "exact":
            for group, each in found["exact_of"].items():
                print(f"    {group}: {share(each)}")
    judged = found["not_judged"]
    print(
        f"  not judged, of samples: healthy {amount(judged['healthy'], '.1%')}, "
        f"faulty {amount(judged['faulty'], '.1%')}"
    )
    error, half = found["size_error"], found["half_width"]["median"]
    print(
        f"  size error: median {amount(error['median'], '.1%')}, "
        f"p90 {amount(error['p90'], '.1%')}; half of the interval {amount(half, '.1%')}"
    )
    print(f"  delay: median {amount(found['delay_s']['median'], '.3g')} s")
    turns = found["windows"]
    print(f"  of faults in turn, in {turns['logs']} logs:")
    for key, text in WINDOWS.items():
        print(f"    {text}: {share(turns[key])}")
    print(f"    events of none of them: {turns['false']}")
    stairs = found["stairs"]
    print(f"  of steps of a fault that jumps, in {stairs['logs']} logs:")
    for key, text in STAIRS.items():
        print(f"    {text}: {share(stairs[key])}")
    print(f"    events of other names: {stairs['false']}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", action="append", choices=list(CASES))
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--healthy", type=int)
    parser.add_argument("--quick", action="store_true", help=f"--runs {QUICK}")
    parser.add_argument("--without-discrepancy", action="store_true")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    faulty = QUICK if given.quick else given.runs
    healthy = max(faulty // 2, 1) if given.healthy is None else given.healthy
    if faulty < 1 or healthy < 1:
        parser.error("--runs and --healthy are at least 1.")
    options = without_discrepancy() if given.without_discrepancy else {}
    every = list[dict[str, Any]]()
    for name in given.case or CASES:
        every.append(
            measure(CASES[name](), faulty, healthy, options, lambda s: print(s, file=sys.stderr))
        )
        show(every[-1])
        if given.json:
            given.json.write_text(json.dumps({"runs": faulty, **options, "cases": every}))


if __name__ == "__main__":
    main()
