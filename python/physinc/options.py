"""Options that several commands have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, TypeAlias

from cyclopts import Parameter, Token, validators


def whole(_: Any, tokens: Sequence[Token]) -> int:
    """Read a whole number; cyclopts by itself rounds others."""
    value = tokens[0].value
    try:
        return int(value)
    except ValueError:
        raise ValueError(f"{value} is no whole number") from None


Frames: TypeAlias = Annotated[int | None, Parameter(converter=whole, validator=validators.Number(gte=1, lt=2**63))]
"""How many frames."""

Flag = Parameter(negative="", show_default=False)
"""An option without a value."""
