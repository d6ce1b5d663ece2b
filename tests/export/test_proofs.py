"""What is shown of the exported C besides its answers: a million steps of nonsense under
sanitizers, and which of its decisions were taken both ways."""

import json
import shutil
import subprocess
from collections import Counter

import numpy as np
import pytest

from drawn_models import calibrated, log_of
from faultgauge.export.compile import print_step
from faultgauge.export.entry import bank_of, step_of
from faultgauge.export.sources import header, step_source, table_source
from faultgauge.plants.plant_file import read_plant_text

pytestmark = pytest.mark.study

# Samples that are no number, infinite, subnormal, huge, and time that goes back; then the logs of
# a file, and these again with states that somebody else has written into.
MAIN = """
#include "tank.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#define WIDTH (sizeof(tank_input) / sizeof(double))
static uint64_t seed = 1;
static uint32_t bits(void)
{
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(seed >> 33);
}
static double drawn(void)
{
    static const double odd[] = {0.0, -0.0, 1e308, -1e308, 5e-324, 1e-310, 1e30, -1e-30};
    const uint32_t k = bits() % 32u;
    if (k == 0) return NAN;
    if (k == 1) return INFINITY;
    if (k == 2) return -INFINITY;
    if (k < 6) return odd[bits() % 8u];
    return (bits() / 2147483648.0 - 0.5) * pow(10.0, (double)(k % 7u) - 3.0);
}
static tank_state state;
static tank_output out;
static void step(const double *values)
{
    tank_input in;
    memcpy(&in, values, sizeof in);
    tank_step(&in, &out, &state);
}
/* A state that comes back damaged: places and counts that are none, and numbers of any kind. */
static int64_t place(void)
{
    return (int64_t)(bits() % 64u ? bits() % 40u : bits()) - 20;
}
static void damage(void)
{
    double *const reals[] = {state.bank_weight, state.bank_lanes_mass, state.bank_lanes_gain,
        state.bank_lanes_score, state.bank_lanes_info, state.bank_lanes_shared,
        state.bank_lanes_eta, state.bank_lanes_J, state.bank_lanes_onset, state.bank_belief_mean,
        state.bank_belief_P, state.bank_begun, state.bank_probe_J, &state.bank_t, &state.last,
        &state.rules_alarm_since, &state.rules_alarm_last, state.rules_names_since,
        state.rules_signs_since, &state.rules_fresh, &state.rules_strange, state.bank_u,
        &state.fits_t, &state.fits_too_little, &state.fits_first, &state.fits_last,
        state.fits_since, &state.fits_lived, &state.fits_sound, &state.fits_restless};
    const uint32_t lengths[] = {7, 96, 288, 96, 96, 96, 672, 2304, 96, 49, 343, 7, 4, 1, 1, 1, 1,
        2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};
    const uint32_t k = bits() % 13u, which = bits() % 30u;
    if (k < 7) {
        const uint32_t first = bits() % lengths[which];
        const double value = drawn();
        for (uint32_t j = 0; j < lengths[which]; j++) {
            if (j == first || k == 0) reals[which][j] = value;
        }
    }
    if (k == 7) state.rows = place();
    if (k == 8) state.intake_flat_times[0] = state.ongoing_calm = place();
    if (k == 9) state.bank_which[bits() % 7u] = place();
    if (k == 10) state.bank_lanes_row[bits() % 96u] = place();
    if (k == 12) {
        state.fits_gone = state.fits_side[0] = place();
        state.fits_named[0] = bits() % 2u, state.fits_vacant = bits() % 2u;
    }
    if (k == 11) {
        for (int j = 0; j < 7; j++) state.bank_which[j] = place();
        for (int j = 0; j < 96; j++) state.bank_lanes_row[j] = place();
    }
}
static void follow(FILE *logs, uint32_t damages)
{
    double values[WIDTH], last = INFINITY;
    for (uint32_t k = 0; fread(values, sizeof values, 1, logs) == 1; k++) {
        if (!(values[0] >= last) || (damages && k % 300u == 0)) tank_init(&state);
        last = values[0];
        if (damages && bits() % damages == 0) damage();
        step(values);
    }
    rewind(logs);
}
int main(void)
{
    double values[WIDTH];
    memset(&state, 0xa5, sizeof state);
    for (int run = 0; run < RUNS; run++) {
        double t = 0;
        tank_init(&state);
        for (int k = 0; k < 500; k++) {
            for (size_t j = 0; j < WIDTH; j++) values[j] = drawn();
            t += run % 3 ? 0.1 : drawn();
            values[0] = t;
            if (run % 5 == 0) values[1] = 0.01; /* an output that is possible, at least */
            step(values);
        }
    }
    FILE *const logs = fopen("samples.bin", "rb");
    if (logs) {
        follow(logs, 0);
        for (int k = 0; k < 10; k++) {
            follow(logs, 3);
            follow(logs, 40);
        }
    }
    return 0;
}
"""
BOUNDED = "min = 0\ntrusted = [0.1, 2.0]\n"  # the level
CALLS = 500  # of a run
MILLION = 1_000_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("c")
    # with bounds: else nothing is outside of what is trusted while it is sampled
    model = calibrated(read_plant_text("tank").replace("min = 0\n", BOUNDED, 1))
    printed = print_step(step_of(bank_of(model)), "tank")
    for end, text in ((".h", header), (".c", step_source), ("_tables.c", table_source)):
        (found / f"tank{end}").write_text(text(printed, ""))
    (found / "main.c").write_text(MAIN)
    np.concatenate([np.stack(list(each.values()), 1) for each in logs(model)]).tofile(
        found / "samples.bin"
    )
    return found


def logs(model):
    """A leak, one that ends, two sizes one after the other, a level that stands still, one that is
    off, a pump that is not known, samples that are too far apart, none at all, a small leak
    whose event is over before the end, and leaks that take turns with filling."""
    rng = np.random.default_rng(5)
    yield log_of(model, 3000, missing=0.05)
    for size in (0.05, -0.2):
        yield log_of(model, 1500, seed=1, size=size)
    gone, back = (log_of(model, 2000, seed=2, size=size) for size in (0.3, 0.0))
    gone["level"][1500:] = back["level"][1500:]
    yield gone
    stands = log_of(model, 1500, size=0.0)
    stands["level"][400:] = stands["level"][400]
    yield stands
    off = log_of(model, 5000, size=0.0)
    off["level"][700:1300] += 0.5 * rng.standard_normal(600)
    off["level"][4500:] += 2.0
    yield off
    blind = log_of(model, 1000, size=0.0)
    blind["u"][300:350], blind["u"][600:640] = np.nan, 1e3
    blind["t"][800:] += 3.0 * np.arange(200)
    yield blind
    none = log_of(model, 300)
    none["level"][:] = np.nan
    yield none
    ends, small = (log_of(model, 2400, seed=2, size=size) for size in (0.0, 0.03))
    ends["level"][300:1400] += (small["level"] - ends["level"])[1200:2300]
    ends["level"][np.random.default_rng(2).random(2400) < 0.02] = np.nan
    yield ends
    turns, leaks = (log_of(model, 4000, size=size) for size in (0.0, 0.3))
    once = (leaks["level"] - turns["level"])[2000:2100]
    for first in range(400, 4000, 200):
        turns["level"][first : first + 100] += once
        turns["level"][first + 100 : first + 200] -= once
    yield turns


def compiled(cc, flags, runs, folder, name):
    command = [cc, "-std=c99", f"-DRUNS={runs}", *flags, "main.c", "tank.c", "tank_tables.c"]
    done = subprocess.run(
        [*command, "-lm", "-o", name], cwd=folder, capture_output=True, text=True, check=False
    )
    if "cannot find" in done.stderr or "unable to" in done.stderr:
        pytest.skip(f"{cc} lacks a library for {' '.join(flags)}")
    assert done.returncode == 0, done.stderr[:2000]


def ran(command, folder):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr)[:2000]
    return done.stdout


def test_a_million_steps_of_nonsense_stay_within_their_memory(cc, folder):
    """Under the address and undefined-behaviour sanitizers, conversions from floating point
    included."""
    flags = ["-O1", "-g", "-fsanitize=address,undefined,float-cast-overflow"]
    compiled(cc, [*flags, "-fno-sanitize-recover=all"], MILLION // CALLS, folder, "fuzzed")
    ran(["./fuzzed"], folder)


def test_nearly_all_ways_are_taken(folder, capsys):
    """Of every condition of the step and its parts, by gcov: 99.7 % were (goal all); the rest is
    listed, and docs/export.md says what it is."""
    if not (shutil.which("gcc") and shutil.which("gcov")):
        pytest.skip("gcc and its gcov are not installed")
    compiled("gcc", ["-O0", "--coverage"], 60, folder, "counted")
    ran(["./counted"], folder)
    told = json.loads(ran(["gcov", "-b", "-j", "-t", "counted-tank.gcno"], folder))
    lines = next(each["lines"] for each in told["files"] if each["file"] == "tank.c")
    text = (folder / "tank.c").read_text().splitlines()
    taken, ways, never = 0, 0, Counter()
    for line in lines:
        counts = [way["count"] for way in line["branches"]]
        taken, ways = taken + sum(n > 0 for n in counts), ways + len(counts)
        if 0 in counts:
            never[text[line["line_number"] - 1].strip()[:90]] += counts.count(0)
    with capsys.disabled():
        print(f"\nconditions: {taken} of {ways} ways taken, {taken / ways:.1%}")
        for line, count in never.most_common():
            print(f"  {count} never: {line}")
    assert taken >= 0.995 * ways
    assert all(line["count"] for line in lines)


# Of what the step decides, at least so much is decided both ways and is shown to decide alone
# (MC/DC); the rest follows from conditions before it.
BOTH_WAYS, ALONE = 0.99, 0.88


def test_decisions_are_taken_both_ways(folder, capsys):
    """Every condition of `tank_step` and its parts, by clang's coverage of conditions, and MC/DC
    from clang 18 on; the mathematics that it calls is none of it."""
    found = [name for name in ("clang-21", "clang-20", "clang-19", "clang-18")
             if shutil.which(name)]  # fmt: skip
    if not found:
        pytest.skip("no clang that measures MC/DC (18 or later) is installed")
    cc, version = found[0], found[0][len("clang") :]
    flags = ["-O0", "-fprofile-instr-generate", "-fcoverage-mapping", "-fcoverage-mcdc"]
    compiled(cc, flags, 60, folder, "covered")
    ran(["env", "LLVM_PROFILE_FILE=raw", "./covered"], folder)
    ran([f"llvm-profdata{version}", "merge", "raw", "-o", "merged"], folder)
    told = ran([f"llvm-cov{version}", "export", "./covered", "-instr-profile=merged"], folder)
    functions = [
        each for each in json.loads(told)["data"][0]["functions"] if "tank_step" in each["name"]
    ]
    assert functions
    text = (folder / "tank.c").read_text().splitlines()
    taken, sides, never = 0, 0, Counter()
    for each in functions:
        for line, _, _, _, true, false, *_ in each["branches"]:
            taken, sides = taken + (true > 0) + (false > 0), sides + 2
            if not (true and false):
                never[text[line - 1].strip()[:90]] += 1
    alone, all_alone = 0, 0
    for each in functions:
        for record in each.get("mcdc_records", []):
            shown = record[-1]
            alone, all_alone = alone + sum(shown), all_alone + len(shown)
    with capsys.disabled():
        print(f"\nconditions: {taken} of {sides} ways taken, {taken / sides:.1%}")
        print(f"MC/DC: {alone} of {all_alone} conditions shown to decide alone")
        for line, count in never.most_common():
            print(f"  {count} not both ways: {line}")
    assert taken >= BOTH_WAYS * sides
    assert alone >= ALONE * all_alone
