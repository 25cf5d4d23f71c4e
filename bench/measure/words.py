"""Numbers in the style of the lab book, with their units; spaces inside a number or before a unit do not break."""

from __future__ import annotations

import math

SPACE = "\N{NO-BREAK SPACE}"
THIN = "\N{NARROW NO-BREAK SPACE}"
MINUS = "\N{MINUS SIGN}"
TIMES = "\N{MULTIPLICATION SIGN}"
SUPERSCRIPTS = str.maketrans(
    "0123456789-", "".join("\N{SUPERSCRIPT ZERO}\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b")
)
PREFIXES = ((1.0, "s"), (1e-3, "ms"), (1e-6, "\N{MICRO SIGN}s"), (1e-9, "ns"))


def number(value: float, digits: int = 3) -> str:
    """Return a number of `digits` significant digits: 0.0123, 12.3, 1 230, 1.2e-7 as a power of ten."""
    if math.isinf(value):
        return "\N{INFINITY}"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if exponent < -3:
        return power(value, exponent, digits)
    text = f"{value:.{max(0, digits - 1 - exponent)}f}"
    return grouped(text).replace("-", MINUS)


def power(value: float, exponent: int, digits: int = 3) -> str:
    """Return a number of `digits` significant digits with that power of ten: 4.67 x 10^9."""
    mantissa = number(value / 10.0**exponent, digits)
    return f"{mantissa}{SPACE}{TIMES}{SPACE}10{str(exponent).translate(SUPERSCRIPTS)}"


def grouped(text: str) -> str:
    """Return the number with separated thousands: 65 536."""
    whole, point, fraction = text.partition(".")
    if len(whole.lstrip("-")) > 4:
        whole = f"{int(whole):,}".replace(",", THIN)
    return whole + point + fraction


def count(value: int) -> str:
    """Return a whole number, exactly."""
    return grouped(str(value))


def things(number: int, thing: str) -> str:
    """Return e.g. `1 case` or `6 cases`."""
    return f"{count(number)}{SPACE}{thing}{'' if number == 1 else 's'}"


def masses(value: float, exact: bool = True) -> str:
    """Return e.g. `65 536 masses`; not exact: to two digits."""
    return f"{count(round(value if exact else float(f'{value:.1e}')))}{SPACE}masses"


def seconds(value: float, digits: int = 3) -> str:
    """Return e.g. `12.3 us`, with the fitting prefix."""
    factor, unit = next(((f, u) for f, u in PREFIXES if value >= f), PREFIXES[-1])
    return f"{number(value / factor, digits)}{SPACE}{unit}"


def times(ratio: float) -> str:
    """Return e.g. `2.5 times`."""
    return f"{number(ratio, 2)}{SPACE}times"


def percent(fraction: float) -> str:
    """Return e.g. `47 %`."""
    return f"{number(100 * fraction, 2)}{SPACE}%"


def bandwidth(value: float) -> str:
    """Return e.g. `35.9 GB/s`."""
    return f"{number(value / 1e9)}{SPACE}GB/s"


def operations(value: float) -> str:
    """Return e.g. `535 G operations/s` or `57.3 T operations/s`."""
    factor, unit = (1e12, "T") if value >= 1e12 else (1e9, "G")
    return f"{number(value / factor)}{SPACE}{unit}{SPACE}operations/s"


def listed(words: list[str]) -> str:
    """Return e.g. `a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""
