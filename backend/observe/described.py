"""What people write by hand or keep in files is read strictly: no unknown fields, no infinities."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(strict=False)]


class Described(BaseModel):
    """A description that does not change once read."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
