"""What all parts of a drawing share: strict, frozen, finite, and no field that the version does not know."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

FARTHEST = 1e9  # m: a number of sixteen digits tells 0.1 µm there


class Part(BaseModel):
    """Base of everything that crosses the file boundary.

    Numbers are numbers (neither text nor true/false), finite, and never rounded. An optional field may be null,
    which says as much as leaving it out.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _null_is_left_out(cls, document: Any) -> Any:
        if not isinstance(document, dict) or None not in document.values():
            return document
        optional = {name for name, field in cls.model_fields.items() if not field.is_required()}
        return {name: value for name, value in document.items() if value is not None or name not in optional}


def _named(value: str) -> str:
    if not value.strip():
        raise ValueError("is empty; give it a name of at least one visible character")
    if value != value.strip() or not value.isprintable():
        raise ValueError(
            f"{value!r} has a space at its end or a control character; remove it, "
            "so that the name can be typed and compared"
        )
    return value


# JSON has arrays only, so a list may stand for a tuple; the numbers inside stay strict.
Id = Annotated[str, AfterValidator(_named)]


def _within_reach(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if (farthest := max(map(abs, vector))) > FARTHEST:
        raise ValueError(
            f"holds {farthest:g}, and beyond {FARTHEST:g} numbers no longer tell a micrometre; write it in m and s"
        )
    return vector


Vector3 = Annotated[tuple[float, float, float], Field(strict=False), AfterValidator(_within_reach)]
