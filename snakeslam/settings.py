"""The base of every settings class: unknown keys are errors, values are checked, nothing changes afterwards."""

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """A frozen group of settings, defined beside its consumer and composed in ``snakeslam.config``."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)
