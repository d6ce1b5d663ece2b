"""Elementwise operations in C, and the helpers that they call."""

from collections.abc import Callable, Sequence

import numpy as np

from faultgauge.errors import InputError
from faultgauge.export.mathematics import INLINE

__all__ = [
    "ELEMENTWISE",
    "FLOATS",
    "HELPERS",
    "LETTERS",
    "TANH_ERROR",
    "Kind",
    "kind_of",
    "literal",
    "truth",
]

TANH_ERROR = 3e-7  # of `fast_tanh`, absolute

Kind = str  # "real", "wide" (double even where real is float), "bool" or an integer type of C
LETTERS = {"real": "r", "wide": "w", "bool": "b", "int64_t": "i", "int32_t": "j"}
FLOATS = ("real", "wide")


def kind_of(dtype: np.dtype) -> Kind:
    """The type in C. Raises `InputError` where it has none."""
    if dtype == np.bool_:
        return "bool"
    if dtype.kind == "f":
        return "real"
    if dtype.kind in "iu":
        # unsigned indices come from JAX's own bookkeeping, and are small
        return "int64_t" if dtype.itemsize > 4 or dtype == np.uint32 else "int32_t"
    raise InputError(f"the model's step has numbers of type {dtype}, which C code has none of.")


def truth(single: bool) -> Kind:
    """The type of truth values in memory: as wide as numbers, so that both are in one vector."""
    return "int32_t" if single else "int64_t"


def literal(value: float | int | bool, kind: Kind, single: bool) -> str:
    """A number in C. In single precision what is beyond its range becomes its edge: such numbers
    are guards ("not 0", "larger than anything"), and stay so."""
    if kind == "bool":
        return "1" if value else "0"
    if kind not in FLOATS:
        return f"INT64_C({int(value)})" if abs(int(value)) >= 2**31 else str(int(value))
    value = float(value)
    if np.isnan(value):
        return "NAN"
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    if not single or kind == "wide":
        return repr(value)
    least, most = (float(each) for each in (np.finfo("f4").tiny, np.finfo("f4").max))
    if value != 0 and abs(value) < least:
        value = float(np.copysign(least, value))
    narrow = np.float32(min(max(value, -most), most))
    text = str(narrow)
    return text + ("f" if "." in text or "e" in text else ".0f")


def _call(name: str) -> Callable[..., str]:
    return lambda a, k, f: f"{name}{f}({', '.join(a)})" if k in FLOATS else f"({a[0]})"


def _binary(sign: str) -> Callable[..., str]:
    return lambda a, k, f: f"({a[0]} {sign} {a[1]})"


def _bits(word: str, sign: str) -> Callable[..., str]:
    return lambda a, k, f: f"({a[0]} {word if k == 'bool' else sign} {a[1]})"


def _helped(name: str) -> Callable[..., str]:
    return lambda a, k, f: f"{name}_{LETTERS[k]}({', '.join(a)})"


def _power(y: int) -> Callable[..., str]:
    def text(a: Sequence[str], k: Kind, f: str) -> str:
        found = " * ".join([f"{a[0]}"] * abs(y)) or "1"
        return f"({found})" if y >= 0 else f"({literal(1, k, bool(f))} / ({found}))"

    return text


# name -> (arguments, their kind, suffix of the functions) -> expression
ELEMENTWISE: dict[str, Callable[[Sequence[str], Kind, str], str]] = {
    "add": _binary("+"),
    "add_any": _binary("+"),
    "sub": _binary("-"),
    "mul": _binary("*"),
    "div": _binary("/"),
    "rem": lambda a, k, f: f"fmod{f}({a[0]}, {a[1]})" if k in FLOATS else f"({a[0]} % {a[1]})",
    "neg": lambda a, k, f: f"(-{a[0]})",
    "max": _helped("fg_max"),
    "min": _helped("fg_min"),
    "atleast": _helped("fg_atleast"),
    "atmost": _helped("fg_atmost"),
    "sign": _helped("fg_sign"),
    "abs": lambda a, k, f: (
        f"fabs{f}({a[0]})" if k in FLOATS else f"({a[0]} < 0 ? -{a[0]} : {a[0]})"
    ),
    "lt": _binary("<"),
    "le": _binary("<="),
    "gt": _binary(">"),
    "ge": _binary(">="),
    "eq": _binary("=="),
    "ne": _binary("!="),
    "and": _bits("&&", "&"),
    "or": _bits("||", "|"),
    "xor": _bits("!=", "^"),
    "not": lambda a, k, f: f"(!{a[0]})" if k == "bool" else f"(~{a[0]})",
    "is_finite": lambda a, k, f: f"(isfinite({a[0]}) != 0)",
    "square": lambda a, k, f: f"({a[0]} * {a[0]})",
    "rsqrt": lambda a, k, f: f"({literal(1, k, bool(f))} / sqrt{f}({a[0]}))",
    "logistic": lambda a, k, f: (
        f"({literal(1, k, bool(f))} / ({literal(1, k, bool(f))} + exp{f}(-{a[0]})))"
    ),
    "floor": _call("floor"),
    "ceil": _call("ceil"),
    **{
        name: _call(name)
        for name in (
            "sqrt", "exp", "log", "log1p", "expm1", "tanh", "erf", "erfc", "pow", "sin", "cos",
            "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "exp2", "cbrt",
        )
    },
}  # fmt: skip

_MAX = """static inline {t} fg_{n}_{l}({t} a, {t} b)
{{
    return (a {s} b) ? a : b;
}}
"""
# one choice after the other: of two conditions in one, compilers make no vectors
_MAX_REAL = """static inline {t} fg_{n}_{l}({t} a, {t} b)
{{
    const {t} m = (a {s} b) ? a : b;
    return (a != a) ? a : m;
}}
"""
_EDGE = """/* `b` is a number, `a` may be none */
static inline {t} fg_{n}_{l}({t} a, {t} b)
{{
    return (a {s} b) ? b : a;
}}
"""
_BEYOND = """/* also where `a` is no number, but after none */
static inline _Bool fg_{n}_{l}({t} a, {t} b)
{{
    return !(a {s}= b) && (b == b);
}}
"""
_NUMBER = """/* `b` where `a` is no number */
static inline {t} fg_number_{l}({t} a, {t} value, {t} b)
{{
    return (a != a) ? b : value;
}}
"""
_FINITE = """/* `b` where `a` is no number or infinite */
static inline {t} fg_finite_{l}({t} a, {t} b)
{{
    return (isfinite(a) != 0) ? a : b;
}}
"""
_TOGETHER = """#pragma omp declare reduction({called}: real: \\
    omp_out = fg_{n}_r(omp_out, omp_in)) initializer(omp_priv = {start})
"""
_SIGN_REAL = """static inline real fg_sign_r(real a)
{
    return (a > 0) ? (real)1 : ((a < 0) ? (real)-1 : a);
}
"""
_SIGN_INT = """static inline {t} fg_sign_{l}({t} a)
{{
    return (a > 0) ? 1 : ((a < 0) ? -1 : 0);
}}
"""
_AT = """/* a place within an array, whatever is asked for */
static inline int32_t fg_at(int64_t place, int32_t last)
{
    return (place < 0) ? 0 : ((place > last) ? last : (int32_t)place);
}
"""
_INT = """/* the nearest that fits; 0 where it is no number */
static inline {t} fg_int_{l}(real a)
{{
    return (a != a) ? 0
        : ((a >= (real){top}) ? {most} : ((a <= -(real){top}) ? (-{most} - 1) : ({t})a));
}}
"""
# A rational minimax approximation of tanh on +-7.9, as Eigen has it (MPL 2.0 in its source; the
# coefficients are numbers).
_TANH = """/* tanh without libm: off by less than {error} everywhere */
static inline real fg_tanh(real a)
{{
    const real x = a > 7.9{f} ? 7.9{f} : a < -7.9{f} ? -7.9{f} : a;
    const real s = x * x, s2 = s * s, s4 = s2 * s2;
    /* by pairs: half as long to wait for as one term after the other */
    const real p0 = 4.89352455891786e-03{f} + 6.37261928875436e-04{f} * s;
    const real p1 = 1.48572235717979e-05{f} + 5.12229709037114e-08{f} * s;
    const real p2 = -8.60467152213735e-11{f} + 2.00018790482477e-13{f} * s;
    const real q0 = 4.89352518554385e-03{f} + 2.26843463243900e-03{f} * s;
    const real q1 = 1.18534705686654e-04{f} + 1.19825839466702e-06{f} * s;
    const real p = (p0 + p1 * s2) + (p2 - 2.76076847742355e-16{f} * s2) * s4;
    const real q = q0 + q1 * s2;
    return x * p / q;
}}
"""
_ERF_INV = """/* Newton's method from Winitzki's approximation: exact to rounding */
static inline real fg_erf_inv(real a)
{{
    const real l = log1p{f}(-a * a), c = 4.33075{f} + l / 2;
    real x = copysign{f}(sqrt{f}(sqrt{f}(c * c - l / 0.147{f}) - c), a);
    int32_t k;
    if (!(fabs{f}(a) < 1)) {{
        return fabs{f}(a) == 1 ? a * INFINITY : NAN;
    }}
    for (k = 0; k < 3; k++) {{
        const real e = (a > 0 ? (1 - a) - erfc{f}(x) : erfc{f}(-x) - (1 + a));
        const real d = e / (1.1283791670955126{f} * exp{f}(-x * x));
        x -= d / (1 + x * d);
    }}
    return x;
}}
"""


def _helpers() -> dict[str, Callable[[bool], str]]:
    found: dict[str, Callable[[bool], str]] = {}

    def fixed(name: str, text: str) -> None:
        found[name] = lambda single: text

    for kind, letter in LETTERS.items():
        if kind == "bool":
            continue
        for n, s in (("max", ">"), ("min", "<")):
            text = _MAX_REAL if kind in FLOATS else _MAX
            fixed(f"fg_{n}_{letter}", text.format(t=kind, n=n, l=letter, s=s))
        for n, s in (("atleast", "<"), ("atmost", ">")):
            fixed(f"fg_{n}_{letter}", _EDGE.format(t=kind, n=n, l=letter, s=s))
        if kind in FLOATS:
            for n, s in (("above", "<"), ("below", ">")):
                fixed(f"fg_{n}_{letter}", _BEYOND.format(t=kind, n=n, l=letter, s=s))
            for n, text in (("number", _NUMBER), ("finite", _FINITE)):
                fixed(f"fg_{n}_{letter}", text.format(t=kind, l=letter))
        if kind not in FLOATS:
            fixed(f"fg_sign_{letter}", _SIGN_INT.format(t=kind, l=letter))
            top, most = (
                ("9223372036854775808.0", "INT64_MAX")
                if kind == "int64_t"
                else ("2147483648.0", "INT32_MAX")
            )
            fixed(f"fg_int_{letter}", _INT.format(t=kind, l=letter, top=top, most=most))
    for n, called, start in (("max", "fg_most", "-INFINITY"), ("min", "fg_least", "INFINITY")):
        fixed(f"reduce_{n}_together", _TOGETHER.format(n=n, called=called, start=start))
    fixed("fg_sign_r", _SIGN_REAL)
    fixed("fg_at", _AT)
    found["fg_tanh"] = lambda single: _TANH.format(f="f" if single else "", error=TANH_ERROR)
    for name, text in INLINE.items():
        fixed(f"fg_{name}", text)
    found["fg_erf_inv"] = lambda single: _ERF_INV.format(f="f" if single else "")
    return found


HELPERS = _helpers()
