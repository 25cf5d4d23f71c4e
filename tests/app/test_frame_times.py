"""The graph of frame times: what its picture says, without a window."""

from __future__ import annotations

import numpy as np

from softlab.app.render import colours
from softlab.app.window.frame_times import BAR, BUDGET, FRAMES, HEIGHT, STICK_OUT, WIDTH, FrameTimes
from softlab.app.window.overlay import force_text


def rows_of(image: np.ndarray, column: int, colour: tuple[float, float, float]) -> np.ndarray:
    """The rows, from the bottom, that have this colour in a column of pixels."""
    return np.flatnonzero((image[:, column, :3] == np.round(255 * np.array(colour))).all(axis=1))


def test_the_newest_frame_is_at_the_right_and_as_high_as_it_took() -> None:
    times = FrameTimes()
    for number in range(FRAMES + 5):
        times.add(number * 1e-5, 0.004)
    times.add(0.006, 0.012)
    image, pixel = times.image(), times.range / HEIGHT  # s
    assert image.shape == (HEIGHT, WIDTH, 4) and times.range == 2 * BUDGET
    np.testing.assert_allclose(times.seconds[0], (6e-5, 0.004))
    line = rows_of(image, 0, colours.WARNING)
    assert len(line) == 1 and line[0] + 1 == round(BUDGET / pixel)  # its upper edge
    for column in (WIDTH - BAR, WIDTH - 1):
        physics, drawing = (rows_of(image, column, colour) for colour in (colours.PHYSICS, colours.DRAWING))
        assert physics[0] == 0 and abs((physics[-1] + 1) * pixel - 0.006) <= pixel
        assert drawing[0] == physics[-1] + 1 and abs((drawing[-1] + 1) * pixel - 0.018) <= pixel


def test_a_few_long_frames_stick_out_and_long_ones_change_the_range() -> None:
    times = FrameTimes()
    assert times.range == 2 * BUDGET
    for _ in range(STICK_OUT):
        times.add(5.0, 5.0)
    assert times.range == 2 * BUDGET
    image = times.image()
    assert len(rows_of(image, WIDTH - 1, colours.PHYSICS)) == HEIGHT - 1  # to the top, but for the line
    times.add(0.03, 0.02)
    assert times.range == 4 * BUDGET
    assert rows_of(times.image(), 0, colours.WARNING)[0] + 1 == HEIGHT // 4


def test_forces_are_told_in_newtons() -> None:
    assert [force_text(newtons) for newtons in (0.01234, 12.34, 1234.5, 2.5e7)] == [
        "0.0123 N", "12.3 N", "1234 N", "2.5e+07 N",
    ]  # fmt: skip
