"""What every table of a configuration file is: a frozen model that knows its keys."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError


class Section(BaseModel):
    """A table of a configuration file: unknown keys are errors, values don't change, a number is a number."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_number_of_words(cls, value: Any, info: ValidationInfo) -> Any:
        """Pydantic would take true for 1 and "5" for 5."""
        field = cls.model_fields.get(info.field_name or "")
        if field is not None and field.annotation in (int, float) and isinstance(value, (bool, str)):
            raise PydanticCustomError("number", "must be a number")
        return value
