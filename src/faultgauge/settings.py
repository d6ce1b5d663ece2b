"""How numeric libraries are set, by what they read from the environment before they are used.

What the environment says already stands.
"""

import gc
import os
import sys
from pathlib import Path

__all__ = ["COMPILER", "cache", "set_for_commands", "set_for_programs"]

COMPILER = " ".join(
    (
        "--xla_cpu_multi_thread_eigen=false",
        # a loop is one kernel, however long it is, where nothing in it is left to a library:
        # no products of matrices (`products.py`), and by the last of these no sums; loops within
        # it stay loops: to write them out takes the compiler half as long again, and gains answers
        # nothing, a calibration less than that
        "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000,"
        "xla_cpu_disable_loop_unrolling",
        "--xla_cpu_experimental_ynn_fusion_type=-reduce",
    )
)


def cache() -> Path:
    """Of the user; what is there can be made again."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "faultgauge"


def set_for_programs() -> None:
    """How our programs are compiled, and where they are kept. Where JAX is loaded already it is
    somebody's, and stays as it is."""
    if "jax" not in sys.modules:
        os.environ.setdefault("XLA_FLAGS", COMPILER)
        os.environ.setdefault("FAULTGAUGE_PROGRAMS", str(cache() / "programs"))


def set_for_commands() -> None:
    """One thread per numeric library: small solves are 7 to 40 times slower with more, and results
    do not depend on the machine's number of cores. All that is compiled is kept."""
    gc.set_threshold(200_000)  # imports and tracing make many objects and few cycles: 8 % faster
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # notes of the compiler, to its makers
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache() / "jax"))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_ENABLE_XLA_CACHES", "none")
