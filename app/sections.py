"""What every table of a configuration file is: a frozen model that knows its keys."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """A table of a configuration file: unknown keys are errors, values don't change."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
