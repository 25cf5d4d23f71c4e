"""Parts that only position-based solvers support: masses of their own, long-range attachments, self-collision."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from softlab.model.base.table import NotNegative, Part, Positive
from softlab.model.tables.self_collision import SelfCollision

MAX_ANCHORS = 4  # per particle


class Load(Part):
    """A mass of the sheet that is heavier or lighter than the others."""

    at: tuple[Annotated[int, Field(ge=0, strict=True)], Annotated[int, Field(ge=0, strict=True)]]  # row, column
    mass: Positive  # kg


class Attachments(Part):
    """Long-range attachments: they limit the distance of a mass from its nearest pins to that along the cloth.

    T.-Y. Kim, N. Chentanez, M. Mueller-Fischer, "Long Range Attachments", SCA 2012. A mass has `anchors` of them
    (fewer, where fewer are pinned), the nearest first, each as long as the path through the sheet at rest, times 1 +
    slack.
    """

    anchors: Annotated[int, Field(ge=1, le=MAX_ANCHORS, strict=True)] = 1
    slack: NotNegative = 0.0


XPBD_KINDS: dict[str, type[Part]] = {"load": Load, "attachments": Attachments, "self_collision": SelfCollision}
