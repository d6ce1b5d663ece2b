"""The tank of commands, verbs and fleets: x' = b u - a x + f, known in closed form, and its logs.

One text and one length of log, so that what one file has compiled serves the others.
"""

import numpy as np

STEP, COUNT = 0.1, 600
A, B, LEAK, NOISE = 0.8, 2.5, 0.6, 0.002
PLANT = """name = "tank"

[states.x]
unit = "m"
derivative = "b*u - a*x"

[inputs.u]
unit = "V"

[outputs.x]
unit = "m"
value = "x"

[parameters]
a = { value = 1.0, min = 0 }
b = { value = 1.0 }

[faults.leak]
enters = "state"
target = "x"
unit = "m/s"
"""


def steps(random, count=COUNT, every=10):
    """A command of -1 V or 1 V that is drawn anew after so many samples."""
    return np.repeat(random.choice([-1.0, 1.0], -(-count // every)), every)[:count]


def level(u, f=0.0, a=A, b=B):
    """x from 0 on, exactly, while `u` and `f` are held."""
    f, decay, x = np.broadcast_to(f, len(u)), np.exp(-a * STEP), np.zeros(len(u))
    for k in range(len(u) - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / a * (b * u[k] + f[k])
    return x


def log(seed, leak=0.0, count=COUNT):
    """t, u and x with sensor noise; a `leak` from the middle on."""
    random = np.random.default_rng(seed)
    u = steps(random, count)
    x = level(u, np.where(np.arange(count) >= count // 2, leak, 0.0))
    return {"t": STEP * np.arange(count), "u": u, "x": x + NOISE * random.standard_normal(count)}


def as_csv(columns, path, digits=10):
    cells = zip(*columns.values(), strict=True)
    rows = (",".join(f"{cell:.{digits}g}" for cell in row) + "\n" for row in cells)
    path.write_text(",".join(columns) + "\n" + "".join(rows))
    return path
