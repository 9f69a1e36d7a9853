"""The kinds of text that a request may hold."""

from typing import Annotated

from pydantic import BeforeValidator, Field

from server.problem import one_line

CONTROL = r"\x00-\x1f\x7f-\x9f\u2028\u2029"
"""Characters that break a line or a terminal; lone surrogates are no text for the validator already."""
Name = Annotated[str, Field(min_length=1, max_length=40, pattern=rf"^[^{CONTROL}]+$")]
"""Shown to all."""


def _shown(value: object) -> object:
    return one_line(value, 200) or None if isinstance(value, str) else value


Words = Annotated[str | None, BeforeValidator(_shown)]
"""Words that are shown as far as they can be, and never a reason to refuse the request that they come with."""
