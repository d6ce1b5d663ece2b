"""The exported C on other machines, by emulators, and under other tools (`make emulators`).

Every test skips where its tool is absent.
"""

import re
import shutil
import subprocess

import numpy as np
import pytest

from drawn_models import calibrated
from faultgauge.cli.app import run
from faultgauge.export.c_project import DEVIATIONS
from faultgauge.plants.model import save_model

pytestmark = pytest.mark.study

# The C libraries round exp and log differently, and the evidence for a fault adds such errors up
# over the vectors: as in test_watch.
CLOSE = 1e-9  # of a signal's largest value

# The exported test with its answers printed as bytes: the machines lay the struct out alike.
SAID = """
#define NO_MAIN
#include "tank_test.c"
#include <stdio.h>
#include <string.h>
int main(void)
{
    static tank_state state;
    tank_input in;
    tank_output out;
    tank_init(&state);
    for (int k = 0; k < COUNT; k++) {
        const unsigned char *said = (const unsigned char *)&out;
        FIELDS
        memset(&out, 0, sizeof out);
        tank_step(&in, &out, &state);
        for (unsigned j = 0; j < sizeof out; j++) printf("%02x", said[j]);
        printf("\\n");
    }
    return tank_test();
}
"""
M4 = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
# An AN386 image of Arm's MPS2 board: code from 0 on, 4 MB of memory; newlib speaks to the host.
BOARD = """
#include <stdint.h>
void _start(void);
void reset(void);
void _init(void) {}
void _fini(void) {}
static const struct { uint32_t stack; void (*start)(void); } vectors
    __attribute__((section(".vectors"), used)) = {0x20400000u, reset};
__attribute__((naked)) void reset(void)
{
    __asm__("ldr r0, =0xE000ED88\\n ldr r1, [r0]\\n orr r1, r1, #(0xF << 20)\\n str r1, [r0]\\n"
            "dsb\\n isb\\n bl _start\\n"); /* with its FPU on */
}
"""
LAYOUT = """
ENTRY(reset)
MEMORY { code (rx) : ORIGIN = 0x0, LENGTH = 4M  data (rwx) : ORIGIN = 0x20000000, LENGTH = 4M }
SECTIONS
{
  .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) *(.ARM.extab*) } > code
  .ARM.exidx : { *(.ARM.exidx*) } > code
  .data : { *(.data*) } > data
  .bss : { __bss_start__ = .; *(.bss*) *(COMMON) __bss_end__ = .; } > data
  end = .; __end__ = .; _end = .;
}
"""


def needed(*programs):
    for each in programs:
        if shutil.which(each) is None:
            pytest.skip(f"{each} is not installed: make emulators installs it on Debian")


def done(command, folder):
    said = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert said.returncode == 0, (command, (said.stdout + said.stderr)[-2000:])
    return said.stdout


@pytest.fixture(scope="module", params=["double", "single"])
def folder(request, tmp_path_factory):
    """Exported C in one precision, and a program that prints what it says of its vectors."""
    found = tmp_path_factory.mktemp(request.param)
    save_model(calibrated("tank"), found / "tank.fgm")
    command = ["export", str(found / "tank.fgm"), "--to", "c", "--out", str(found / "c")]
    assert run([*command, "--precision", request.param]) == 0
    test = (found / "c" / "tank_test.c").read_text()
    fields = " ".join(re.findall(r"in\.\w+ = samples\[k\]\[\d+\];", test))
    count = re.search(r"samples\[(\d+)\]", test)[1]
    said = SAID.replace("FIELDS", fields).replace("COUNT", count)
    (found / "c" / "said.c").write_text(said)
    (found / "c" / "board.c").write_text(BOARD)
    (found / "c" / "board.ld").write_text(LAYOUT)
    return found / "c"


def parsed(text, folder):
    """The answers as records."""
    real = "f4" if "float x_level" in (folder / "tank.h").read_text() else "f8"
    kinds = {"float": real, "double": "f8", "int32_t": "i4", "bool": "?"}
    struct = (folder / "tank.h").read_text().split("} tank_output;")[0].rsplit("{", 1)[1]
    members = re.findall(r"^\s*(\w+) (\w+);", struct, re.MULTILINE)
    dtype = np.dtype([(name, kinds[kind]) for kind, name in members], align=True)
    return np.frombuffer(bytes.fromhex(text.replace("\n", "")), dtype)


@pytest.fixture
def here(folder, cc):
    files = ["said.c", "tank.c", "tank_tables.c"]
    done([cc, "-std=c99", "-O2", *files, "-o", "here", "-lm"], folder)
    return parsed(done(["./here"], folder), folder)


def on_aarch64(folder):
    needed("aarch64-linux-gnu-gcc", "qemu-aarch64")
    files = ["said.c", "tank.c", "tank_tables.c"]
    done(["aarch64-linux-gnu-gcc", "-std=c99", "-O2", "-static", *files, "-o", "there", "-lm"],
         folder)  # fmt: skip
    return done(["qemu-aarch64", "./there"], folder)


def on_cortex_m4(folder):
    needed("arm-none-eabi-gcc", "qemu-system-arm")
    gcc = ["arm-none-eabi-gcc", *M4]
    start = done([*gcc, "-print-file-name=rdimon-crt0.o"], folder).strip()
    files = ["board.c", "said.c", "tank.c", "tank_tables.c", start]
    link = ["--specs=rdimon.specs", "-nostartfiles", "-T", "board.ld"]
    done([*gcc, "-std=c99", "-O2", *link, *files, "-o", "there.elf", "-lm"], folder)
    host = ["-nographic", "-monitor", "none", "-serial", "none"]
    host += ["-semihosting-config", "enable=on,target=native"]
    command = ["timeout", "300", "qemu-system-arm", "-M", "mps2-an386", *host]
    return done([*command, "-kernel", "there.elf"], folder)


@pytest.mark.parametrize("machine", [on_aarch64, on_cortex_m4])
def test_other_machines_say_the_same(folder, here, machine):
    """Their programs end with the exported test, which must agree with Python; in double every
    answer is that of this machine too."""
    found = parsed(machine(folder), folder)
    assert len(found) == len(here) > 0
    if here["x_level"].dtype == np.float32:
        return  # evidence on its way is off by more than rounding: the exported test bounds it
    for name in here.dtype.names:
        one, other = found[name], here[name]
        if other.dtype.kind != "f":
            np.testing.assert_array_equal(one, other, err_msg=name)
            continue
        limit = CLOSE * max(np.nanmax(np.abs(other), initial=0.0), 1e-9)
        np.testing.assert_allclose(one, other, rtol=0, atol=limit, err_msg=name)


def test_neither_malloc_nor_printf_is_linked(folder):
    """A linker that keeps only what the step reaches keeps neither."""
    needed("arm-none-eabi-gcc", "arm-none-eabi-nm")
    flags = ["-std=c99", "-O2", "-ffunction-sections", "-fdata-sections", "-nostartfiles"]
    link = ["--specs=nosys.specs", "-Wl,--gc-sections", "-Wl,-e,tank_step", "-Wl,-u,tank_init"]
    files = ["tank.c", "tank_tables.c"]
    done(["arm-none-eabi-gcc", *M4, *flags, *link, *files, "-o", "step.elf", "-lm"], folder)
    listed = [line.split() for line in done(["arm-none-eabi-nm", "step.elf"], folder).splitlines()]
    names = {each[-1] for each in listed}
    assert {"tank_step", "tank_init"} <= names
    unwanted = re.compile(r"_?(malloc|calloc|realloc|free|sbrk|\w*printf|puts|write|f?open)(_r)?$")
    assert not [name for name in names if unwanted.match(name)]


def test_every_deviation_from_misra_is_explained(folder):
    needed("cppcheck")
    files = ["tank.c", "tank_tables.c", "tank.h"]
    said = subprocess.run(
        ["cppcheck", "--std=c99", "--addon=misra", "--enable=style", "--quiet",
         "--template={id}", *files],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    found = set(re.findall(r"misra-c2012-([\d.]+)", said.stderr))
    assert found, said.stderr[:2000]
    assert found <= set(DEVIATIONS)
    readme = (folder / "README.md").read_text()
    assert all(f"- {rule}: {why}" in readme for rule, why in DEVIATIONS.items())
