"""What cannot be is refused with the reason: scenes, how they run, how they are shared, what functions are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import refused_runs
import refused_scenes

from softlab.model.base.errors import InputError, SceneError


@pytest.mark.parametrize(
    "make, words", [pytest.param(*case, id=case[1]) for case in (*refused_scenes.ALL, *refused_runs.ALL)]
)
def test_what_cannot_be_is_refused(make: Callable[[], Any], words: str) -> None:
    with pytest.raises((SceneError, InputError), match=words):
        make()
