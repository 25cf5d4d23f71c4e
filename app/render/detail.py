"""Quality of a picture in space, since a processor needs many milliseconds where a graphics card needs almost none."""

from __future__ import annotations

from dataclasses import dataclass

SOFTWARE = ("llvmpipe", "softpipe", "swiftshader", "swrast")  # in the names of drivers that draw with the processor


@dataclass(frozen=True)
class Detail:
    """Quality of a picture: `samples` per pixel for smooth edges, limited by the driver; one pixel is drawn per block
    of `coarse` x `coarse` pixels of the window; `shadows` on the ground. `meaning`: description."""

    name: str
    samples: int
    coarse: int
    shadows: bool
    meaning: str


FINE = Detail("fine", 4, 1, True, "smooth edges and shadows")
PLAIN = Detail("plain", 0, 1, True, "shadows, no edge smoothing")
QUICK = Detail("quick", 0, 2, False, "a quarter of the pixels, no shadows, no edge smoothing")
DETAILS = (FINE, PLAIN, QUICK)


def by_software(renderer: str) -> bool:
    """Return True if a processor draws, by the driver's name for itself."""
    return any(word in renderer.lower() for word in SOFTWARE)


def usual_detail(renderer: str) -> Detail:
    """Return the quality with which the window starts."""
    return QUICK if by_software(renderer) else FINE


def next_detail(detail: Detail) -> Detail:
    """Return the next quality, in a cycle."""
    return DETAILS[(DETAILS.index(detail) + 1) % len(DETAILS)]
