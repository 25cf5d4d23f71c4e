"""The base of every table of a scene, and its kinds of numbers: finite, bounded, not converted from other types."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer

Table = dict[str, Any]  # fields of a part by name, as a scene file has them: not checked yet
Tables = Mapping[str, Any]  # of a scene by name, a title beside them
Number = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Vector = tuple[Number, Number, Number]  # x, y (up), z
ZERO: Vector = (0.0, 0.0, 0.0)
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
Flag = Annotated[bool, Field(strict=True)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
AtLeastOne = Annotated[float, Field(ge=1, allow_inf_nan=False, strict=True)]
MAX_COUNTED = 2**31 - 1  # masses along a side: their indices are 32-bit
Count = Annotated[int, Field(ge=1, le=MAX_COUNTED, strict=True)]
Sweeps = Annotated[int, Field(ge=1, le=1000, strict=True)]  # over contacts, after each iteration
Seed = Annotated[int, Field(ge=0, le=2**64 - 1, strict=True)]


class Part(BaseModel):
    """Base of every table of a scene: frozen, unknown keys refused.

    `contradicts`: the fields that become invalid when a field gets another value.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    contradicts: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    def _idle_fields(self) -> set[str]:
        """Return the fields without effect here, which are left out where the part is written.

        So scenes keep the text by which stores of measurements identify them when fields are added later.
        """
        return set()

    @model_serializer(mode="wrap")
    def _without_idle_fields(self, serialize: SerializerFunctionWrapHandler) -> dict[str, object]:
        idle = self._idle_fields()
        return {name: value for name, value in serialize(self).items() if name not in idle}
