"""Colours: a diverging colour map of strain for any colour vision, and its ranges.

Blue is compressed, grey is at rest, red is stretched. Both ends are darker than the middle, so the amount of strain can
be read from lightness alone, and the sign from hue (blue against red is safe for all common colour vision
deficiencies).
"""

from __future__ import annotations

import numpy as np

BACKGROUND = (1.0, 1.0, 1.0)
INK = (0.10, 0.12, 0.15)
FAINT = (0.38, 0.41, 0.46)  # what is read last
PIN = (0.05, 0.05, 0.05)
SELECTED = (0.93, 0.55, 0.00)  # orange: on neither side of the map
POKE = (0.00, 0.47, 0.36)  # green with a strong luminance step to both red and grey
WARNING = (0.70, 0.12, 0.00)
CLOTH_FRONT = (0.36, 0.50, 0.66)  # slate blue before, sand behind: apart in lightness too
CLOTH_BACK = (0.85, 0.73, 0.56)
COLLIDER = (0.70, 0.71, 0.73)
GROUND = (0.92, 0.93, 0.94)
GROUND_LINE = (0.66, 0.69, 0.73)
SHADOW = (0.80, 0.82, 0.85)
PHYSICS = (0.16, 0.36, 0.60)  # in the graph of frame times; apart in lightness
DRAWING = (0.80, 0.62, 0.24)

BODIES = (  # of neighbouring numbers; apart in lightness or from blue to yellow, which every colour vision tells
    (0.82, 0.56, 0.14),
    (0.28, 0.50, 0.73),
    (0.28, 0.60, 0.46),
    (0.74, 0.38, 0.28),
    (0.57, 0.46, 0.70),
    (0.80, 0.73, 0.35),
    (0.42, 0.68, 0.79),
    (0.77, 0.51, 0.62),
)

STOPS = np.array(
    [
        [0.02, 0.14, 0.45],
        [0.22, 0.48, 0.85],
        [0.70, 0.70, 0.70],
        [0.90, 0.42, 0.25],
        [0.55, 0.00, 0.10],
    ],
    dtype=np.float32,
)  # at -1, -0.5, 0, 0.5, 1 times the strain range


LEVELS = np.array(
    [[1.0, 0.96, 0.75], [0.99, 0.80, 0.40], [0.98, 0.51, 0.20], [0.84, 0.15, 0.15], [0.42, 0.0, 0.15]], dtype=np.float32
)  # at 0, 0.25 ... 1 times the range of what has no sign: ever darker, from yellow to red


def level_colours(level: np.ndarray, most: float) -> np.ndarray:
    """Return the colours (..., 3) float32 in 0 to 1 of levels (...,) from 0 to `most`. Values that are not finite have
    the colour of the largest."""
    fraction = np.clip(np.nan_to_num(np.asarray(level) / most, nan=1.0, posinf=1.0), 0, 1)
    places = np.linspace(0, 1, len(LEVELS))
    return np.stack([np.interp(fraction, places, LEVELS[:, k]) for k in range(3)], axis=-1).astype(np.float32)


def strain_colours(strain: np.ndarray, strain_range: float) -> np.ndarray:
    """Return the colours (..., 3) float32 in 0 to 1 of strains (...,), saturated at +-strain_range. The shader does the
    same."""
    place = (np.clip(np.asarray(strain) / strain_range, -1, 1) + 1) * (len(STOPS) - 1) / 2
    low = np.minimum(place.astype(int), len(STOPS) - 2)
    fraction = (place - low)[..., None]
    return (STOPS[low] * (1 - fraction) + STOPS[low + 1] * fraction).astype(np.float32)


def strain_range(strain: np.ndarray) -> float:
    """Return a round range (1, 2 or 5 times a power of ten, at least 0.01) that contains all but the largest 2 % of
    |strain|."""
    size = np.abs(strain[np.isfinite(strain)])
    worst = float(np.quantile(size, 0.98)) if len(size) else 0.0
    return round_up(min(max(worst, 0.01), 1e6))


def round_up(worst: float) -> float:
    """Return the smallest 1, 2 or 5 times a power of ten that is at least `worst` > 0."""
    power = 10.0 ** np.floor(np.log10(worst * (1 + 1e-9)))
    for step in (1, 2, 5, 10):
        if worst <= step * power * (1 + 1e-9):
            return float(step * power)
    return float(10 * power)
