"""The base of everything read from a file: strict parts, and numbers that know their unit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_after_validator_function

from artemis.yaml_file import KeyPath, dotted


class Config(BaseModel):
    """Part of a mission or robot file: frozen, strict, unknown keys and non-finite numbers refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class OpenConfig(Config):
    """The same, but unknown keys belong to something else, which checks them."""

    model_config = ConfigDict(extra="allow")

    @property
    def options(self) -> dict[str, object]:
        """The keys of the other."""
        return dict(self.model_extra or {})


class Inconsistent(ValueError):
    """Parts of a mapping that do not fit together.

    Attributes:
        problems: path of the key below the mapping, and what is wrong with it.
    """

    def __init__(self, problems: Sequence[tuple[KeyPath, str]]) -> None:
        super().__init__("; ".join(f"{dotted(path)}: {text}" for path, text in problems))
        self.problems = problems


@dataclass(frozen=True, slots=True)
class Quantity:
    """Annotates a number: from `low` to `high` in `unit` (empty: a ratio), which every real machine satisfies."""

    low: float
    high: float
    unit: str
    signed: bool = False
    """Its size counts; it may be negative."""

    def check(self, number: float) -> float:
        """The number itself.

        Raises:
            ValueError: it is beyond; with the units it may be meant in.
        """
        if self._has(number):
            return number
        sign = ", positive or negative" if self.signed else ""
        unit = f" {self.unit}" if self.unit else ""
        meant = f"expected {self.low:g} to {self.high:g}{unit}{sign}, found {number:g}{unit}"
        mistaken = _MISTAKEN.get(self.unit, ()) if number else ()
        hints = [f"in {unit}? then write {right:.4g}" for unit, turn in mistaken if self._has(right := turn(number))]
        if hints:
            raise ValueError(f"{meant}: is it {'; '.join(hints)}")
        if not self.signed and self._has(-number):
            raise ValueError(f"{meant}: leave the minus sign out")
        raise ValueError(meant)

    def _has(self, number: float) -> bool:
        return self.low <= (abs(number) if self.signed else number) <= self.high

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Checked after its type."""
        return no_info_after_validator_function(self.check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """With the bounds."""
        return {**handler(schema), "minimum": -self.high if self.signed else self.low, "maximum": self.high}


def _times(factor: float) -> Callable[[float], float]:
    return lambda number: number * factor


def _inverse(number: float) -> float:
    return 1.0 / number


_MISTAKEN: dict[str, tuple[tuple[str, Callable[[float], float]], ...]] = {
    "m": (("millimetres", _times(1e-3)), ("centimetres", _times(1e-2))),
    "m/s": (("millimetres per second", _times(1e-3)), ("km/h", _times(1 / 3.6))),
    "m/s²": (("mm/s²", _times(1e-3)), ("multiples of gravity", _times(9.81))),
    "m per count": (
        ("counts per metre", _inverse),
        ("millimetres per count", _times(1e-3)),
        ("counts per millimetre", lambda number: 1e-3 / number),
    ),
    "degrees": (("radians", degrees),),
    "degrees/s": (("radians per second", degrees), ("millidegrees per second", _times(1e-3))),
    "degrees/V": (
        ("radians per volt", degrees),
        ("degrees per millivolt", _times(1e3)),
        ("volts per degree", _inverse),
    ),
    "V": (("millivolts", _times(1e-3)),),
    "mA": (("amperes", _times(1e3)),),
    "s": (("milliseconds", _times(1e-3)), ("minutes", _times(60.0))),
    "rpm": (("turns per second", _times(60.0)), ("radians per second", _times(degrees(1.0) / 6.0))),
    "mN·m/A": (("newton metres per ampere", _times(1e3)), ("micronewton metres per ampere", _times(1e-3))),
    "motor turns per wheel turn": (("wheel turns per motor turn", _inverse),),
}
"""By unit: in which other one a number may have been written, and what it is then."""
